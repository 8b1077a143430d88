"""Gains that are chosen for an arm keep within its inertia at the control period, follow, and are stored as numbers."""

import itertools
from pathlib import Path
from typing import Annotated, NamedTuple

import mujoco
import numpy as np
import pytest

import torquebench
from tests.arms import THREE
from tests.sweep.examples import plan_of
from torquebench import (
    Array,
    Gain,
    Option,
    bias_forces,
    controller,
    gravity,
    load_model,
    mass_matrix,
)
from torquebench.chain import CHAINS, Chain
from torquebench.errors import ConfigError, ControllerError
from torquebench.experiment import dump_experiment, load_experiment, parse_experiment
from torquebench.experiment.describe import chosen_text
from torquebench.experiment.run import run_experiment
from torquebench.laws import find_law
from torquebench.laws.law import law_names
from torquebench.tuning import SHARE, braked, friction_text, least_inertia, limits_of

WRIST = """
<mujoco model="wrist"><worldbody>
  <body><inertial mass="0.2" pos="0 0 0.03" diaginertia="1e-4 1e-4 1e-4"/><joint name="roll" axis="0 0 1"/></body>
  </worldbody><actuator><motor joint="roll" ctrlrange="-28 28"/></actuator></mujoco>"""


SLIDER = """
<mujoco model="slider"><worldbody>
  <body><inertial mass="2" pos="0 0 0" diaginertia="0.01 0.01 0.01"/><joint name="lift" type="slide" axis="0 0 1"/>
    <body><inertial mass="1" pos="0.2 0 0" diaginertia="0.01 0.05 0.05"/><joint name="turn" axis="0 1 0"/></body></body>
  </worldbody>
  <actuator><motor joint="lift" ctrlrange="-90 90"/><motor joint="turn" ctrlrange="-9 9"/></actuator></mujoco>"""


UNEVEN = Chain(torque_gain=(2.0, 0.5, 1.4))
"""Drives that give more than asked, and less."""


@pytest.fixture
def three(tmp_path: Path) -> Path:
    """The light arm's file."""
    path = tmp_path / "three.xml"
    path.write_text(THREE)
    return path


def masses(path: Path, count: int, seed: int) -> Array:
    """MuJoCo's mass matrices at random positions, (count, n, n)."""
    m = mujoco.MjModel.from_xml_path(str(path))
    d, rng, found = mujoco.MjData(m), np.random.default_rng(seed), np.zeros((count, m.nv, m.nv))
    for M in found:
        d.qpos[:] = rng.uniform(-np.pi, np.pi, m.nv)
        mujoco.mj_forward(m, d)
        mujoco.mj_fullM(m, d, M)
    return found


@pytest.mark.parametrize("chain", [CHAINS["ideal"], CHAINS["slow"], UNEVEN], ids=["ideal", "slow", "uneven"])
@pytest.mark.parametrize("law", ["smc", "linear-band-smc", "pd"])
def test_linear_terms_stay_within_what_the_inertia_stands(three: Path, law: str, chain: Chain) -> None:
    """The terms keep r rho(M^-1 D) <= SHARE at poses that were not looked at, 5 % allowed, and more than 0.3 SHARE.

    D is K / phi + Kd of the law times the drives' gains, r the chain's reaction, M MuJoCo's.
    """
    arm = load_model(three)
    options = {"switching": "saturation"} if law == "smc" else {}
    gains = find_law(law).choose_gains(arm, 0.001, chain, options)
    D = np.zeros(3)
    if "k" in gains:
        D += np.array(gains["k"]) * arm.flat.tau_max / np.array(gains["phi"])
    if "kv" in gains:
        D += np.array(gains["kv"]) * arm.flat.inertia_scale
    D *= np.array(chain.torque_gain)
    moved = chain.reaction(0.001) * np.max(np.abs(np.linalg.eigvals(np.linalg.inv(masses(three, 500, seed=7)) * D)))
    assert 0.3 * SHARE < moved <= 1.05 * SHARE


def test_the_least_inertia_of_coupled_joints_is_below_each_joints_own() -> None:
    """Of M = [[a, b], [b, c]] it is det M / (c (1 + r)) and det M / (a (1 + r)), r = |b| / sqrt(a c): by hand."""
    a, b, c = 2.0, 0.9, 0.5
    det, r = a * c - b * b, b / np.sqrt(a * c)
    found = least_inertia(np.array([[[a, b], [b, c]], [[a, 0.0], [0.0, c]]]))
    assert found == pytest.approx([det / (c * (1 + r)), det / (a * (1 + r))])
    assert least_inertia(np.array([[[a, 0.0], [0.0, c]]])) == pytest.approx([a, c])


def test_gains_of_one_joint_by_hand(tmp_path: Path) -> None:
    """M = 1e-4 kg m^2 under 28 N m: lambda 20; K = 0.8 phi M / T with phi = 0.005 lambda; kV 80; kI = kV lambda^2 / 4.

    Behind the slow chain the loop answers after 1 + 5 + 8 ms: lambda = 0.8 / (4 x 0.014). What is given stays as it is
    given, and the others go with it: with lambda = 12 phi is 0.06.
    """
    path = tmp_path / "wrist.xml"
    path.write_text(WRIST)
    arm, layer = load_model(path), {"switching": "saturation"}
    k = 0.8 * 0.1 * 1e-4 / 0.001 / 28.0
    smc = find_law("smc")
    assert smc.choose_gains(arm, options=layer) == pytest.approx({"lam": 20.0, "k": k, "phi": 0.1}, rel=5e-3)
    assert "phi" not in smc.choose_gains(arm)
    assert smc.choose_gains(arm, 0.002)["k"] == pytest.approx(k / 2.0, rel=5e-3)
    assert find_law("computed-torque").choose_gains(arm) == {"lam": 20.0, "kv": 80.0, "ki": 8000.0}
    assert find_law("pd").choose_gains(arm) == {"lam": 20.0, "kv": 80.0}
    slow = find_law("computed-torque").choose_gains(arm, chain=CHAINS["slow"])
    assert slow["lam"] == pytest.approx(0.8 / (4.0 * 0.014), rel=5e-3)
    delayed = find_law("computed-torque").choose_gains(arm, chain=Chain(measurement_delay=0.013))
    assert delayed == slow
    given = smc.choose_gains(arm, options=layer, given={"lam": 12})
    assert given["lam"] == 12
    assert given["phi"] == pytest.approx(0.06)
    wide = smc.choose_gains(arm, options=layer, given={"k": 0.3})
    assert wide["phi"] == pytest.approx(8.4 * 0.001 / (0.8 * 1e-4), rel=5e-3)


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_gains_times_those_of_the_drives_are_what_they_are_without(tmp_path: Path, gain: float) -> None:
    """Of rates and switching torques, of a joint whose torque limit bounds none of them; slopes stay."""
    path = tmp_path / "wrist.xml"
    path.write_text(WRIST)
    arm, drives = load_model(path), Chain(torque_gain=gain)
    assert find_law("computed-torque").choose_gains(arm, chain=drives) == {
        "lam": 20.0,
        "kv": 80.0 / gain,
        "ki": 8000.0 / gain,
    }
    assert find_law("pd").choose_gains(arm, chain=drives) == {"lam": 20.0, "kv": 80.0 / gain}
    bare, behind = (
        find_law("smc").choose_gains(arm, chain=c, options={"switching": "saturation"}) for c in (Chain(), drives)
    )
    assert (behind["lam"], behind["phi"]) == (bare["lam"], bare["phi"])
    assert behind["k"] * gain == pytest.approx(bare["k"], rel=5e-3)  # three digits


def test_joints_that_slide_are_masses(tmp_path: Path) -> None:
    """A lift of 3 kg that carries a turning 1 kg at 0.2 m: M = [[3, 0.2 c], [0.2 c, 0.09]], c = cos q up to 1.

    So I = det / (0.09 (1 + r)) for the lift, r = 0.2 / sqrt(0.27), where the axes are most coupled; the limit of 90 N
    less 29.4 N brakes 0.1 m at lambda = 14.2.
    """
    path = tmp_path / "slider.xml"
    path.write_text(SLIDER)
    limits = limits_of(load_model(path))
    least = (0.27 - 0.04) / (0.09 * (1.0 + 0.2 / np.sqrt(0.27)))
    assert limits.least[0] == pytest.approx(least, rel=1e-3)
    assert limits.heaviest == pytest.approx([3.0, 0.09])
    gains = find_law("computed-torque").choose_gains(load_model(path))
    assert gains["lam"][0] == pytest.approx(np.sqrt((90.0 - 3.0 * 9.81) / (3.0 * 0.1)), rel=5e-3)


def followed(path: Path, arm, lam: Array, K: Array, phi: Array) -> float:
    """Largest error from 1 s on of K sat(s/phi) with MuJoCo's own inverse dynamics, (1 - cos) sines of 0.5 rad."""
    m = mujoco.MjModel.from_xml_path(str(path))
    m.opt.timestep, m.opt.integrator = 0.001, mujoco.mjtIntegrator.mjINT_RK4
    d, inverse, worst, w = mujoco.MjData(m), mujoco.MjData(m), 0.0, np.pi
    for step in range(2000):
        t = 0.001 * step
        e = 0.25 * (1.0 - np.cos(w * t)) - d.qpos
        de = 0.25 * w * np.sin(w * t) - d.qvel
        worst = max(worst, np.max(np.abs(e))) if t >= 1.0 else worst
        inverse.qpos[:], inverse.qvel[:] = d.qpos, d.qvel
        inverse.qacc[:] = 0.25 * w * w * np.cos(w * t) + lam * de
        mujoco.mj_inverse(m, inverse)
        tau = inverse.qfrc_inverse + K * np.clip((de + lam * e) / phi, -1.0, 1.0)
        d.ctrl[:] = np.clip(tau, -arm.flat.tau_max, arm.flat.tau_max)
        mujoco.mj_step(m, d)
    return worst


def test_an_independent_loop_follows_with_them_and_not_with_four_times_as_much(three: Path) -> None:
    """A loop of plain MuJoCo stays below 1 mrad; with 4 K in the same layers, 3.2 by the bound, it comes apart."""
    arm = load_model(three)
    gains = find_law("smc").choose_gains(arm, options={"switching": "saturation"})
    lam, K, phi = np.array(gains["lam"]), np.array(gains["k"]) * arm.flat.tau_max, np.array(gains["phi"])
    good, bad = followed(three, arm, lam, K, phi), followed(three, arm, lam, 4.0 * K, phi)
    assert good < 1e-3
    assert bad > 5.0 * good


SHIPPED = [name for name in law_names() if find_law(name).function.__module__.startswith("torquebench.")]


@pytest.mark.parametrize("name", SHIPPED)
def test_every_gain_of_every_law_can_be_chosen(name: str, three: Path) -> None:
    """Whatever the options, each gain that acts gets numbers that the law takes, and no other gain is named."""
    law = find_law(name)
    for arm in (load_model("puma560"), load_model(three)):
        for values in itertools.product(*(option.values for option in law.options.values())):
            options = dict(zip(law.options, values, strict=True))
            gains = law.choose_gains(arm, options=options)
            assert list(gains) == [key for key, gain in law.gains.items() if gain.acts(options)]
            law.pack_gains(arm.n, gains, options)
    assert law.choose_gains(arm, 0.001) == law.choose_gains(arm, 0.001)


TEXT = """\
name: own
plant: {model: two-link}
controllers:
  - {law: smc, gains: auto}
  - {name: twelve, law: smc, switching: saturation, gains: {from: auto, lam: 12}}
  - {law: computed-torque, gains: {lam: 10, kv: 20, ki: 0}}
reference: {kind: sine, amplitude: 0.5, frequency_hz: 0.5}
run: {duration: 2}
"""


def test_the_config_is_stored_with_numbers() -> None:
    """Nothing of what is stored says auto; it reads back equal; the line tells just the gains that were chosen."""
    found = parse_experiment(TEXT)
    first, second, third = found.controllers
    arm = load_model("two-link")
    assert first.gains == find_law("smc").choose_gains(arm)
    options = {"switching": "saturation"}
    assert second.gains == find_law("smc").choose_gains(arm, options=options, given={"lam": 12.0})
    assert third.gains == {"lam": 10.0, "kv": 20.0, "ki": 0.0}
    text = dump_experiment(found)
    assert "auto" not in text
    assert parse_experiment(text) == found
    assert chosen_text(parse_experiment(text)) == []
    lines = chosen_text(found)
    assert [line.split("'")[1] for line in lines] == ["smc", "twelve"]
    assert "two-link at 1 ms: lam [" in lines[0]
    assert "lam" not in lines[1]
    assert lines[1].endswith("phi 0.06 rad/s")


@pytest.mark.parametrize(("other", "unit"), [("hinge", "rad/s (m/s for slides)"), ("slide", "m/s")])
def test_gains_of_slides_are_told_in_their_units(tmp_path: Path, other: str, unit: str) -> None:
    """The line has both units where some joints turn and some slide."""
    body = '<body><joint name="{}" type="{}" axis="{}"/><inertial mass="2" pos="0.1 0 0" diaginertia="1 1 1"/>'
    inside = body.format("b", other, "0 1 0")
    motors = "".join(f'<motor joint="{name}" ctrlrange="-9 9"/>' for name in "ab")
    arm = f"<worldbody>{body.format('a', 'slide', '1 0 0')}{inside}</body></body></worldbody>"
    (tmp_path / "cart.xml").write_text(f"<mujoco>{arm}<actuator>{motors}</actuator></mujoco>")
    path = tmp_path / "own.yaml"
    path.write_text(TEXT.replace("two-link", "cart.xml"))
    assert chosen_text(load_experiment(path))[1].endswith(f" {unit}")


def test_gains_follow_what_is_set_beside_the_file(tmp_path: Path) -> None:
    """They are chosen after ``--set``: for the period, the chain and the gains that it gives, and by name."""
    path = tmp_path / "own.yaml"
    path.write_text(TEXT)
    first, slow, behind, given, named = (
        load_experiment(path, overrides).controllers[0].gains
        for overrides in (
            (),
            ["run.control_period=0.004"],
            ["chain=slow"],
            ["controllers.smc.gains.k=0.5"],
            ["controllers.computed-torque.gains=auto", "controllers.smc.gains=auto"],
        )
    )
    assert np.all(np.array(slow["k"]) < np.array(first["k"]))
    assert np.all(np.array(behind["lam"]) <= np.array(first["lam"]))
    assert given == {"lam": first["lam"], "k": 0.5}
    assert named == first
    assert load_experiment(path).with_({"controllers.smc.gains": "auto"}).controllers[0].gains == first


def test_what_extends_a_controller_with_chosen_gains_may_give_some() -> None:
    """``gains: {lam: 12}`` beside ``extends`` of one that says auto leaves the others to be chosen, to go with it."""
    text = TEXT.replace(
        "  - {law: computed-torque", "  - {extends: smc, name: more, gains: {lam: 12}}\n  - {law: computed-torque"
    )
    gains = parse_experiment(text).controllers[2].gains
    assert gains == find_law("smc").choose_gains(load_model("two-link"), given={"lam": 12.0})


def test_a_sweep_chooses_gains_for_each_of_its_runs() -> None:
    """In a case with twice the period the second K is half as large; what goes with a slope goes with each draw."""
    sweep = "sweep: {draws: 3, grid: {run.control_period: [0.001, 0.002]}, random: {%s: {uniform: [8, 12]}}}\n"
    plan = plan_of(TEXT + sweep % "controllers.twelve.gains.lam")
    k = [np.array(plan.experiment(case, 0).controllers[0].gains["k"]) for case in (0, 1)]
    assert k[1][1] == pytest.approx(0.5 * k[0][1], rel=0.01)
    for draw in range(3):
        gains = plan.experiment(0, draw).controllers[1].gains
        assert 8.0 < gains["lam"] < 12.0
        assert gains["phi"] == pytest.approx(0.005 * gains["lam"], rel=0.01)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("gains: aut", "did you mean 'auto'"),
        ("gains: {from: auto, lamm: 3}", "unknown gain (did you mean 'lam'?)"),
        ("gains: {from: auto, phi: 3}", "gain 'phi' has no effect"),
        ("gains: {from: auto, k: -1}", "more than 0"),
        ("gains: {from: auto, k: [1, 2, 3]}", "got 3 numbers"),
    ],
)
def test_mistakes_beside_auto_are_told(text: str, words: str) -> None:
    """A name that is none, an unknown gain, one without effect, and numbers out of range, each at its key."""
    with pytest.raises(ConfigError, match=r"controllers\[0\]\.gains") as caught:
        parse_experiment(TEXT.replace("gains: auto", text))
    assert words in str(caught.value)


def test_gains_of_a_users_law_are_chosen_by_their_units_or_by_their_own_rule() -> None:
    """lam, k and phi as of `smc` without a model; a rule of its own counts first; one without a unit must be given."""

    class Own(NamedTuple):
        lam: Annotated[Array, Gain("slope", "1/s")]
        k: Annotated[Array, Gain("switching gain over torque limit", "1")]
        phi: Annotated[Array, Gain("band", "rad/s")]
        two: Annotated[Array, Gain("anything", "kg", auto=lambda fit: 2.0 * fit.lam)]
        bare: Array

    @controller("tuned-by-a-test", gains=Own)
    def own(gains, model, t, q, qd, ref, memory, tau):
        """Nothing."""

    law, arm = find_law("tuned-by-a-test"), load_model("two-link")
    with pytest.raises(ControllerError, match="gain 'bare'"):
        law.choose_gains(arm)
    found = law.choose_gains(arm, given={"bare": 1.0})
    options = {"switching": "saturation", "equivalent_control": False}
    like = find_law("smc").choose_gains(arm, options=options)
    assert {name: found[name] for name in ("lam", "k", "phi")} == like
    assert found["two"] == pytest.approx([2.0 * x for x in np.broadcast_to(found["lam"], 2)], rel=5e-3)
    text = TEXT.replace("law: smc, gains: auto", "law: tuned-by-a-test, gains: auto")
    with pytest.raises(ConfigError, match=r"gain 'bare' \[not stated\] has no rule"):
        parse_experiment(text)


class Sliding(NamedTuple):
    """Gains of a law of a user's."""

    lam: Annotated[Array, Gain("slope", "1/s")]
    k: Annotated[Array, Gain("switching gain over torque limit", "1")]
    phi: Annotated[Array, Gain("band", "rad/s")]
    full: Annotated[int, Option("whether the model is used", (True, False))]


def blind(gains, model, t, q, qd, ref, memory, tau):
    """Carry gravity alone."""
    gravity(model, q, tau)


def called(model, q, qd, qdd, tau):
    """Call the model for a law."""
    torquebench.inverse_dynamics(model, q, qd, qdd, tau)


def through(gains, model, t, q, qd, ref, memory, tau):
    """Call the model in another function."""
    called(model, q, qd, ref.qdd, tau)


def in_parts(gains, model, t, q, qd, ref, memory, tau):
    """Call what makes inverse dynamics up."""
    mass_matrix(model, q, memory.M)
    bias_forces(model, q, qd, tau)


@pytest.mark.parametrize(
    ("function", "declared", "full", "has"),
    [
        (blind, None, True, False),
        (through, None, True, True),
        (in_parts, None, True, True),
        (blind, True, True, True),
        (through, False, True, False),
        (through, ("full", True), True, True),
        (through, ("full", True), False, False),
    ],
)
def test_a_users_law_with_a_model_gets_the_gains_of_one(registries, function, declared, full, has) -> None:
    """What it calls decides, else what it declares: then lam, k and phi are those of `smc` with or without a model."""
    controller("own-model", gains=Sliding, has_model=declared)(function)
    law, arm = find_law("own-model"), load_model("puma560")
    assert law.has_model({"full": full}) is has
    like = find_law("smc").choose_gains(arm, options={"switching": "saturation", "equivalent_control": has})
    other = find_law("smc").choose_gains(arm, options={"switching": "saturation", "equivalent_control": not has})
    assert law.choose_gains(arm, options={"full": full}) == like != other


def test_what_a_users_law_was_taken_for_is_said(registries) -> None:
    """Beside its chosen gains; nothing is said of a law of the package, and a choice it does not have is refused."""
    controller("own-blind", gains=Sliding)(blind)
    text = TEXT.replace("law: smc, gains: auto", "law: own-blind, gains: auto")
    own = [line for line in chosen_text(parse_experiment(text)) if "without a model" in line]
    assert len(own) == 1
    assert "has_model=True" in own[0]
    assert not any("model," in line for line in chosen_text(parse_experiment(TEXT)))
    with pytest.raises(ControllerError, match="'has_model' depends on option 'ful'"):
        controller("own-wrong", gains=Sliding, has_model=("ful", True))(blind)


def test_gains_overcome_the_friction_of_the_file(tmp_path: Path) -> None:
    """With b = 2 N m s/rad, 0.1 N m on M = 1e-4 kg m^2: T b / M = 20, so it stands T b / (1 - exp(-20)) = 2e-3.

    F = 4.1 N m: sqrt(F / (4 x 0.005 M)) is beyond 0.8 / (4 T) = 200, so lambda = 200; K = D phi = 0.8 x 2 x 1 = 1.6
    is below 1.5 F, so K = 6.15 N m and phi = K / D; Kd = D = 1.6, as 4 lambda M and F / (0.005 lambda) ask for 4.1.
    Behind too small a limit, F counts as what is left of it over 1.5.
    """
    path = tmp_path / "wrist.xml"
    path.write_text(WRIST.replace('name="roll"', 'name="roll" damping="2" frictionloss="0.1"'))
    arm, layer = load_model(path), {"switching": "saturation"}
    smc = find_law("smc").choose_gains(arm, options=layer)
    assert smc == pytest.approx({"lam": 200.0, "k": 6.15 / 28.0, "phi": 6.15 / 1.6}, rel=6e-3)
    pd = find_law("pd").choose_gains(arm)
    assert pd["kv"] * arm.flat.inertia_scale[0] == pytest.approx(1.6, rel=6e-3)
    path.write_text(path.read_text().replace("28", "0.9"))
    weak = find_law("smc").choose_gains(load_model(path), options=layer)
    assert weak["k"] == pytest.approx(1.0, rel=6e-3)


def test_what_friction_leaves_is_said_and_why(tmp_path: Path) -> None:
    """F / (lambda D) with D = K / phi, at 2 rad/s, here 4.1 / (200 x 1.6) = 12.8 mrad; and what keeps it from less.

    On M = 1 of 10 N m s/rad, at 6 ms, the slope is what 28 N m and the damping brake 0.1 rad with: 0.1 M lambda^2 =
    28 + 0.1 x 10 lambda. Without friction nothing is said.
    """
    path, text = tmp_path / "wrist.xml", WRIST.replace('name="roll"', 'name="roll" {}')

    def said(own: str, law: str = "smc", period: float = 1e-3, **given: float) -> str:
        path.write_text(text.format(own))
        arm, options = load_model(path), {"switching": "saturation"} if law == "smc" else {}
        kind = find_law(law)
        fit = kind.fit(arm, period, Chain(), options, kind.choose_gains(arm, period, options=options, given=given))
        return friction_text(fit, arm.joint_names, [False], given)

    assert said("") == said("", "computed-torque") == ""
    quick = said('damping="2" frictionloss="0.1"')
    assert quick.startswith("friction of the arm's file leaves about 12.8 mrad of roll at 2 rad/s: slope and damping")
    assert "rad/s, until its integral takes that up: " in said('damping="2" frictionloss="0.1"', "pid")
    for law in ("pd", "gravity-friction", "position-servo"):
        assert said('damping="2" frictionloss="0.1"', law).startswith(quick[:50])
    given = said('damping="2" frictionloss="0.1"', lam=100.0)
    assert given.startswith("friction of the arm's file leaves about 25.6 mrad")
    assert given.endswith("with lam as given")
    assert "more than gravity leaves" in said('damping="20"')
    assert said('damping="11" armature="0.1"', "pd-gravity").endswith("over 1.5")
    heavy = said('damping="10" armature="1"', period=6e-3)
    assert "brakes 0.1 rad along" in heavy
    limits = limits_of(load_model(path))
    lam = braked(limits)[0]
    assert 0.1 * limits.heaviest[0] * lam**2 == pytest.approx(28.0 + 0.1 * 10.0 * lam)


def test_what_friction_takes_is_followed(tmp_path: Path) -> None:
    """On that wrist a 0.5 rad sine is held to 10 mrad by each law; gains that overlook friction leave it at rest."""
    path = tmp_path / "wrist.xml"
    path.write_text(WRIST.replace('name="roll"', 'name="roll" damping="2" frictionloss="0.1"'))
    text = (
        "name: own\nplant: {model: wrist.xml, engine: analytic, timestep: 0.0001, integrator: rk4}\n"
        "controllers:\n  - {law: smc, switching: saturation, gains: auto}\n  - {law: computed-torque, gains: auto}\n"
        "  - {law: pd, gains: auto}\n"
        "reference: {kind: sine, amplitude: 0.5, frequency_hz: 0.5}\nrun: {duration: 2.0, metrics_from: 0.5}\n"
    )
    (tmp_path / "own.yaml").write_text(text)
    result = run_experiment(load_experiment(tmp_path / "own.yaml"))
    errors = {name: metrics.rmse.value for name, metrics in result.metrics.items()}
    assert set(errors) == {"smc", "computed-torque", "pd"}
    assert max(errors.values()) < 0.011


@pytest.mark.parametrize(
    ("law", "given"),
    [
        ("computed-torque", {"kv": 4.0}),
        ("computed-torque", {"lam": 20.0, "kv": 4.0}),
        ("pid", {"kv": 1.0}),
        ("pid", {"lam": 200.0}),
        ("pid", {"lam": 20.0, "kv": 4.0}),
        ("gravity-friction", {"kp": 0.02}),
        ("gravity-friction", {"kp": 20.0}),
    ],
)
def test_what_goes_with_given_gains_is_stable(tmp_path: Path, law: str, given: dict[str, float]) -> None:
    """The poles of the wrist's loop decay, at a sixth of the middle one's size at least, where a gain is given alone.

    M e'' + D e' + P e + I int e = 0 with M = 1e-4 kg m^2, Mbar the arm's own scale; Routh: D P > M I.
    """
    path = tmp_path / "wrist.xml"
    path.write_text(WRIST)
    arm = load_model(path)
    gains = find_law(law).choose_gains(arm, given=given)
    assert given.items() <= gains.items()
    M, scale = 1e-4, arm.flat.inertia_scale[0]
    if law == "gravity-friction":
        loop = [M, gains["kd"], gains["kp"]]
    else:
        times = M if law == "computed-torque" else scale
        loop = [M, times * gains["kv"], times * gains["kv"] * gains["lam"], times * gains["ki"]]
    poles = np.roots(loop)
    middle = (loop[-1] / M) ** (1.0 / len(poles))
    assert np.max(poles.real) < -middle / 6.0
