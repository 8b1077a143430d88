"""A good config becomes exactly the experiment it describes; laws and arms of users' own are checked the same."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import pytest

import torquebench
from tests.experiment.examples import ALL, GOOD, MINIMAL, edited, parse, properties
from torquebench.errors import ConfigError, ControllerError
from torquebench.experiment import as_vector, dump_experiment, experiment_json_schema, load_experiment
from torquebench.experiment.controllers import OWN_KEYS
from torquebench.kernel import Array
from torquebench.laws.declare import RESERVED, Gain, Option
from torquebench.laws.law import controller, find_law


def test_every_key_arrives_where_it_belongs() -> None:
    """Each value of the fully written config is found under the attribute of the same name."""
    x = parse(GOOD)
    assert (x.name, x.description, x.chain.name) == ("good", "every section, one key per line", "ideal")
    assert (x.plant.engine, x.plant.model, x.plant.timestep, x.plant.integrator) == (
        "mujoco",
        "puma560",
        0.001,
        "rk4",
    )
    assert (x.model.structure, x.model.constants) == ("corrected", "printed")
    assert x.model.mismatch is not None
    assert x.model.mismatch.relative == 0.3
    first, second = x.controllers
    assert (first.name, first.law, first.expect) == ("conventional", "smc", "completed")
    assert first.options == {"equivalent_control": True, "switching": "saturation", "surface": "pd"}
    assert first.gains == {"lam": 10.0, "k": 0.3, "phi": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)}
    assert second.options == {"equivalent_control": False, "switching": "saturation"}
    assert second.gains == {"lam": 10.5, "k": 0.25, "phi": 0.35, "kv": 20.0}
    assert x.reference.kind == "sine"
    assert (x.reference.amplitude, x.reference.frequency_hz) == ((1.2, -1.0, 1.0, 1.1, 1.0, 1.0), 0.75)
    (noise,) = x.disturbances
    assert (noise.kind, noise.channel, noise.sigma, noise.hold, noise.clip_sigma) == (
        "band-limited-noise",
        "torque",
        0.5,
        0.02,
        2.5,
    )
    assert (x.run.duration, x.run.control_period, x.run.initial_q) == (4.0, 0.002, "home")
    assert (x.run.seed, x.run.metrics_from, x.run.draw) == (7, 1.25, 3)


def test_off_is_a_word_and_not_false() -> None:
    """A bare off chooses an option's value off, a bare false a boolean's; neither is read as the other."""
    options = "compensation: off, band: off, integral: false, linear: true, equivalent_control: measured-acceleration"
    law = f"law: fuzzy-linear-band-smc, {options}, gains: {{lam: 5, kv: 10}}"
    (only,) = parse(MINIMAL.replace("law: pd, gains: {lam: 5, kv: 10}", law)).controllers
    assert only.options == {
        "equivalent_control": "measured-acceleration",
        "compensation": "off",
        "integral": False,
        "band": "off",
        "linear": True,
    }


def test_defaults_are_the_documented_ones() -> None:
    """What a minimal config leaves out has the documented defaults."""
    x = parse(MINIMAL)
    assert x.description is None
    assert (x.plant.timestep, x.plant.integrator) == (0.001, "rk4")
    assert x.plant.engine == "analytic"
    assert (x.plant.structure, x.plant.constants) == ("exact", "fitted")
    assert (x.model.structure, x.model.constants, x.model.mismatch) == ("exact", "fitted", None)
    assert (x.controllers[0].expect, x.controllers[0].options, x.chain.name) == ("completed", {}, "ideal")
    assert (x.run.control_period, x.run.initial_q, x.run.seed, x.run.draw) == (0.001, "home", 0, 0)
    assert x.disturbances == ()
    (noise,) = parse(MINIMAL, "disturbances=[{kind: band-limited-noise, channel: torque, sigma: 1}]").disturbances
    assert (noise.hold, noise.clip_sigma) == (0.01, 3.0)


@pytest.mark.parametrize(("kind", "start"), [("sine", 1.0), ("step", 2.0), ("ramp", 1.0), ("quintic", 1.0)])
def test_metrics_start_depends_on_the_reference(kind: str, start: float) -> None:
    """Left out, the metrics' window starts at 2 s for a step and at 1 s otherwise."""
    text = ALL["good" if kind == "sine" else kind].replace("  metrics_from: 1.25\n", "")
    assert parse(text).run.metrics_from == start


def test_derived_numbers() -> None:
    """4 s at 2 ms are 2000 control instants of two 1 ms physics steps; 20 ms of hold are 10 of them."""
    x = parse(GOOD)
    assert (x.n, x.n_steps, x.substeps, x.disturbances[0].hold_steps(2000, 0.002)) == (6, 2000, 2, 10)
    tenth = parse(GOOD, "run.control_period=0.1", "plant.timestep=0.1", "run.duration=4.3", "disturbances=[]")
    assert (tenth.n_steps, tenth.substeps) == (43, 1)  # 4.3 / 0.1 is 42.99999999999999 in binary


def test_as_vector_repeats_numbers_and_copies_lists() -> None:
    """One number serves all joints; a list keeps its order; the result is the caller's own array."""
    assert np.array_equal(as_vector(2.0, 3), [2.0, 2.0, 2.0])
    assert np.array_equal(as_vector((1.0, 2.0, 3.0), 3), [1.0, 2.0, 3.0])
    assert as_vector(2.0, 3).dtype == np.float64
    as_vector(2.0, 3)[0] = 1.0


def test_gains_fit_the_law() -> None:
    """What the loader accepts, the law packs without complaint."""
    for entry in parse(GOOD).controllers:
        packed = find_law(entry.law).pack_gains(6, entry.gains, entry.options)
        assert np.array_equal(packed.k, as_vector(entry.gains["k"], 6))


def test_experiment_is_read_only() -> None:
    """A loaded experiment cannot be changed by accident, nor built with unknown keys."""
    x = parse(GOOD)
    with pytest.raises(FrozenInstanceError):
        x.name = "other"  # type: ignore[misc]
    with pytest.raises(FrozenInstanceError):
        x.run.duration = 1.0  # type: ignore[misc]
    with pytest.raises(TypeError):
        type(x.run)(duration=1.0, metrics_from=0.0, colour="red")  # type: ignore[call-arg]


def test_load_reads_the_file(tmp_path: Path) -> None:
    """From disk, with an override, the same experiment comes out as from text; messages carry the path."""
    path = tmp_path / "x.yaml"
    path.write_text(GOOD)
    assert load_experiment(path, ["run.seed=9"]) == parse(GOOD, "run.seed=9")
    path.write_text(edited("seed: 7", "sed: 7"))
    with pytest.raises(ConfigError, match=r"x\.yaml:46:3: run\.sed: unknown key \(did you mean 'seed'\?\)"):
        load_experiment(path)


class OddGains(NamedTuple):
    """A user's law with awkward names: a gain called like a method of the schema's classes, a mixed option."""

    schema: Array
    copy: Annotated[Array, Gain("a gain that may be zero", "N m", positive=False)]
    mode: Annotated[int, Option("how to do it", ("auto", True, False))]


class BareGains(NamedTuple):
    """A law without gains."""


class ClashingGains(NamedTuple):
    """An option with the name of a key that every controller has."""

    expect: Annotated[int, Option("taken", ("a", "b"))]


@pytest.mark.usefixtures("registries")
def test_a_users_law_is_checked_like_the_shipped_ones() -> None:
    """A registered law's gains and options are known to the loader and the schema, whatever they are called."""

    def law() -> None:
        """Do nothing."""

    controller("odd", gains=OddGains)(law)
    controller("bare", gains=BareGains)(law)
    text = MINIMAL.replace("law: pd, gains: {lam: 5, kv: 10}", "law: odd, mode: true, gains: {schema: 0, copy: 2}")
    x = parse(text)
    assert x.controllers[0].gains == {"schema": 0.0, "copy": 2.0}
    assert x.controllers[0].options == {"mode": True}
    assert parse(dump_experiment(x)) == x
    assert {"schema", "copy", "mode"} <= {key for key, _ in properties(experiment_json_schema(["odd"]))}
    assert parse(MINIMAL.replace("law: pd, gains: {lam: 5, kv: 10}", "law: bare")).controllers[0].gains == {}
    for override, key, word in [
        ("mode=1", "mode", "got 1, wanted one of auto, true, false"),
        ("mode=1.0", "mode", "got 1.0, wanted one of auto, true, false"),
        ("mode=atuo", "mode", "did you mean 'auto'"),
        ("gains.schema=-1", "gains.schema", "at least 0"),
        ("gains.coppy=1", "gains.coppy", "did you mean 'copy'"),
    ]:
        with pytest.raises(ConfigError) as caught:
            parse(text, f"controllers.only.{override}")
        (problem,) = caught.value.problems
        assert problem.key == f"controllers[0].{key}"
        assert word in problem.message


@pytest.mark.usefixtures("registries")
def test_an_option_may_not_take_the_name_of_a_common_key() -> None:
    """A law whose option would shadow ``expect`` cannot be registered, and the keys reserved are the schema's."""
    with pytest.raises(ControllerError, match="no option may be called 'expect'"):
        controller("clash", gains=ClashingGains)(lambda: None)
    assert set(RESERVED) == {*OWN_KEYS, "gains", "fuzzy"}


TWO_LINKS = """\
<mujoco>
  <worldbody>
    <body name="a"><joint name="a" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="b" pos="1 0 0"><joint name="b" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="a" ctrlrange="-9 9" ctrllimited="true"/>
    <motor joint="b" ctrlrange="-9 9" ctrllimited="true"/>
  </actuator>
</mujoco>
"""


def test_other_arms_have_their_own_number_of_joints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Vector lengths follow the arm that is named, and closed forms are refused for any but the PUMA."""
    pytest.importorskip("mujoco")
    folder = tmp_path / "models" / "two-links"
    folder.mkdir(parents=True)
    (folder / "two-links.xml").write_text(TWO_LINKS)
    monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path))
    text = MINIMAL.replace("puma560", "two-links")
    assert parse(text, "reference.target=[1, 2]").n == 2
    for override, key, word in [
        ("reference.target=[1, 2, 3]", "reference.target", "wanted one number or 2"),
        ("model.structure=corrected", "model.structure", "wanted exact"),
        ("model.constants=printed", "model.constants", "wanted fitted"),
        ("plant.structure=printed", "plant.structure", "wanted exact"),
        ("plant.model=puma560", "plant.model", "unknown model"),
    ]:
        with pytest.raises(ConfigError) as caught:
            parse(text, override)
        assert caught.value.problems[0].key == key
        assert word in caught.value.problems[0].message


def test_pydantic_stays_inside_the_experiment_package() -> None:
    """No other package imports pydantic: configs are one layer's business."""
    source = Path(torquebench.__file__).parent
    users = {path.parent.name for path in source.rglob("*.py") if "pydantic" in path.read_text()}
    assert users <= {"experiment"}
