"""From a config to the loop's objects: what is drawn, from which key, and that truth and belief stay apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.experiment.examples import MINIMAL, parse
from torquebench.experiment.build import Loop, build
from torquebench.experiment.run import run_experiment
from torquebench.kernel import Array
from torquebench.robot import load_model
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant

STEPS = 131
"""Number of control instants, each of four physics steps; not a multiple of any hold below but one instant."""
TIMING = ("run.control_period=0.004", "run.duration=0.524", "run.metrics_from=0")
STEP_TIMES = 0.004 * np.arange(STEPS)


def noise(sigma: str = "1", hold: float = 0.02, clip: float = 3.0) -> str:
    """Return one disturbance in YAML."""
    return f"{{kind: band-limited-noise, channel: torque, sigma: {sigma}, hold: {hold}, clip_sigma: {clip}}}"


def built(*overrides: str) -> Loop:
    """Return the loop of the minimal config under the overrides."""
    return build(parse(MINIMAL, *TIMING, *overrides))


def disturbance(*entries: str, seed: int = 7, draw: int = 3) -> Array:
    """Return the disturbance of a config with these entries."""
    found = built(f"disturbances=[{', '.join(entries)}]", f"run.seed={seed}", f"run.draw={draw}").disturbance
    assert found is not None
    return found


def expected_noise(key: tuple[int, int, int], sigma: Any, hold_steps: int, clip: float, n: int = 6) -> Array:
    """Return the noise of (seed, draw, index): stream 1 of the keyed generator, clipped, scaled, then held."""
    seed, draw, index = key
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(draw, 1, index)))
    blocks = rng.standard_normal((-(-STEPS // hold_steps), n))
    return np.array([np.clip(blocks[k // hold_steps], -clip, clip) * sigma for k in range(STEPS)])


def test_disturbances_are_added_up() -> None:
    """Three entries, each with its own size, hold, clip and stream, act together: the torque is their sum."""
    sizes = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    total = disturbance(noise("[1, 2, 3, 4, 5, 6]", 0.02, 2.5), noise("0.5", 0.008, 1.0), noise("0.2", 0.004, 3.0))
    wanted = (
        expected_noise((7, 3, 0), sizes, 5, 2.5)
        + expected_noise((7, 3, 1), 0.5, 2, 1.0)
        + expected_noise((7, 3, 2), 0.2, 1, 3.0)
    )
    # sums of three terms of order 10, in either order
    assert total == pytest.approx(wanted, rel=1e-13, abs=1e-13)
    assert total.shape == (STEPS, 6)


def test_equal_disturbances_are_drawn_separately() -> None:
    """A second entry equal to the first leaves the first's draw as it is and adds another one, independent of it."""
    one, two = disturbance(noise()), disturbance(noise(), noise())
    # one draw a hold; 27 x 6 of them: an independent pair is correlated by 0.08 or so, an equal one by 1
    first, second = one[::5].ravel(), (two - one)[::5].ravel()
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.4
    assert 0.7 < np.std(second) < 1.3
    assert two - one == pytest.approx(expected_noise((7, 3, 1), 1.0, 5, 3.0), abs=1e-14)


@pytest.mark.parametrize(("hold", "steps"), [(0.004, 1), (0.012, 3), (0.04, 10)])
def test_hold_is_a_time_not_a_number_of_physics_steps(hold: float, steps: int) -> None:
    """A value lasts `hold` seconds: hold / control_period instants, then the next is another one."""
    torque = disturbance(noise(hold=hold))[:, 0]
    changes = np.flatnonzero(np.diff(torque)) + 1
    assert np.array_equal(changes, np.arange(steps, STEPS, steps))


def test_noise_follows_seed_and_draw() -> None:
    """The same seed and draw give the same torque to the last bit; another seed or another draw another torque."""
    base = disturbance(noise())
    assert np.array_equal(base, disturbance(noise()))
    for seed, draw in ((8, 3), (7, 4), (3, 7), (0, 3), (7, 0)):
        other = disturbance(noise(), seed=seed, draw=draw)
        assert not np.any(other == base)
        assert other == pytest.approx(expected_noise((seed, draw, 0), 1.0, 5, 3.0), abs=1e-14)


BIAS = "{kind: bias, channel: torque, value: [1, -2, 3, 0, 0.5, -0.5]}"
SINUSOID = "{kind: sinusoid, channel: torque, rms: [3, 2, 1, 0, 0.5, 4], frequency_hz: 2.5}"


def test_bias_and_sinusoid_are_what_they_are_called() -> None:
    """A constant; sqrt(2) RMS sin(2 pi f k T), f of 1 Hz unless given; an amplitude is taken as it is."""
    value, rms = np.array([1.0, -2.0, 3.0, 0.0, 0.5, -0.5]), np.array([3.0, 2.0, 1.0, 0.0, 0.5, 4.0])
    assert disturbance(BIAS).tolist() == [value.tolist()] * STEPS
    swing = np.sin(2.0 * np.pi * 2.5 * STEP_TIMES)
    assert disturbance(SINUSOID) == pytest.approx(np.outer(swing, np.sqrt(2.0) * rms), abs=1e-13)
    slow = disturbance("{kind: sinusoid, channel: torque, amplitude: [-1, 2, 0, 0, 0, 0]}")
    assert slow[:, :2] == pytest.approx(np.outer(np.sin(2.0 * np.pi * STEP_TIMES), [-1.0, 2.0]), abs=1e-13)
    assert not np.any(slow[:, 2:])


def test_a_noise_keeps_its_numbers_whatever_stands_beside_it() -> None:
    """Biases and sinusoids before, between and after two noises change neither: only noises count in the key."""
    two = expected_noise((7, 3, 0), 1.0, 5, 3.0) + expected_noise((7, 3, 1), 2.0, 5, 3.0)
    others = disturbance(BIAS) + disturbance(SINUSOID) + disturbance(BIAS)
    among = disturbance(BIAS, noise(), SINUSOID, noise("2"), BIAS)
    assert among == pytest.approx(two + others, rel=1e-13, abs=1e-13)


def test_no_disturbance_is_none() -> None:
    """A config without disturbances makes no array of zeros."""
    assert built().disturbance is None


def wrong(structure: str, r: float, *overrides: str, seed: int = 7, draw: int = 3) -> Loop:
    """Return the loop of a config with a mismatch."""
    return built(
        f"model.structure={structure}",
        "model.constants=printed",
        f"model.mismatch.relative={r}",
        f"run.seed={seed}",
        f"run.draw={draw}",
        *overrides,
    )


@pytest.mark.parametrize("structure", ["corrected", "printed"])
def test_mismatch_follows_seed_and_draw(structure: str) -> None:
    """The belief's constants are (1 +- r) of the tables', with signs from stream 0 of (seed, draw) and nothing else."""
    nominal = load_model("puma560", structure, "printed").flat.constants
    seen = set()
    for seed, draw in ((7, 3), (7, 4), (8, 3), (0, 0), (3, 7)):
        loop = wrong(structure, 0.3, seed=seed, draw=draw)
        factors = loop.model.flat.constants / nominal
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(draw, 0, 0)))
        assert factors == pytest.approx(np.where(rng.integers(0, 2, 34) == 1, 1.3, 0.7), rel=1e-14)
        assert loop.redraws == 0
        again = wrong(structure, 0.3, f"disturbances=[{noise()}]", seed=seed, draw=draw)
        assert np.array_equal(again.model.flat.constants, loop.model.flat.constants)
        seen.add(loop.model.flat.constants.tobytes())
    assert len(seen) == 5


def test_rejected_draws_are_counted() -> None:
    """At r = 0.9 some draws are rejected and the loop says how many; at r = 0.1, none, nor without a mismatch."""
    counts = [wrong("corrected", 0.9, draw=draw).redraws for draw in range(6)]
    assert max(counts) > 0
    assert len(set(counts)) > 1
    assert wrong("corrected", 0.1).redraws == built().redraws == 0


ANALYTIC = ("plant.structure=corrected", "plant.constants=printed")


def state_after(loop: Loop) -> Array:
    """Return position and velocity 50 steps after rest at a bent pose, under a constant torque."""
    loop.plant.reset(np.linspace(0.2, 0.7, 6), np.zeros(6))
    loop.plant.step(np.array([5.0, -20.0, 8.0, 1.0, -1.0, 0.5]), 50)
    return np.concatenate(loop.plant.state())


def test_mismatch_is_in_the_belief_and_not_in_the_plant() -> None:
    """A plant with the belief's own structure and constants moves the same, bit for bit, with or without a mismatch."""
    right = built(*ANALYTIC, "model.structure=corrected", "model.constants=printed")
    off = wrong("corrected", 0.3, *ANALYTIC)
    assert np.array_equal(state_after(right), state_after(off))
    assert not np.array_equal(right.model.flat.constants, off.model.flat.constants)


def test_plant_and_belief_have_their_own_structure_and_constants() -> None:
    """Structure and constants of plant and belief are taken each from its own section."""
    start, torque = np.linspace(0.2, 0.7, 6), np.array([5.0, -20.0, 8.0, 1.0, -1.0, 0.5])
    for truth in (("exact", "fitted"), ("corrected", "fitted"), ("printed", "printed")):
        loop = built(
            f"plant.structure={truth[0]}",
            f"plant.constants={truth[1]}",
            "model.structure=corrected",
            "model.constants=printed",
        )
        alone = AnalyticPlant(load_model("puma560", *truth), 0.001, "rk4")
        alone.reset(start, np.zeros(6))
        alone.step(torque, 50)
        assert np.array_equal(state_after(loop), np.concatenate(alone.state())), truth
        belief = load_model("puma560", "corrected", "printed")
        assert np.array_equal(loop.model.inverse_dynamics(start, start, start), belief.inverse_dynamics(*[start] * 3))


def test_belief_can_be_overwritten_without_touching_plant_or_next_build() -> None:
    """A belief's arrays cannot be written to, and spoiling its scratch space changes no plant and no later belief."""
    config = (*ANALYTIC, "model.structure=corrected", "model.constants=printed")
    loop = built(*config)
    before, pose = state_after(loop), np.linspace(0.2, 0.7, 6)
    mass_matrix = loop.model.mass_matrix(pose)
    arrays = [
        value
        for name, value in vars(loop.model.flat).items()
        if isinstance(value, np.ndarray) and not name.startswith("_")
    ]
    assert len(arrays) > 10
    assert not any(array.flags.writeable for array in arrays)
    for value in loop.model.flat.scratch:
        value[...] = 3
    assert np.array_equal(state_after(loop), before)
    fresh = built(*config)
    assert np.array_equal(state_after(fresh), before)
    assert np.array_equal(fresh.model.mass_matrix(pose), mass_matrix)


@pytest.mark.parametrize("engine", ["analytic", "mujoco"])
@pytest.mark.parametrize("integrator", ["rk4", "euler"])
def test_plant_has_the_engine_step_and_integrator_of_the_config(engine: str, integrator: str) -> None:
    """The plant moves as the named engine does with the named step and integrator, bit for bit."""
    plant = f"plant={{engine: {engine}, model: two-link, timestep: 0.002, integrator: {integrator}}}"
    loop = built(plant)
    alone: Any = (
        AnalyticPlant(load_model("two-link"), 0.002, integrator)
        if engine == "analytic"
        else MujocoPlant("two-link", 0.002, integrator)
    )
    for each in (loop.plant, alone):
        each.reset(np.array([0.3, -0.8]), np.array([1.0, 2.0]))
        each.step(np.array([3.0, -1.0]), 20)
    assert type(loop.plant) is type(alone)
    assert np.array_equal(loop.plant.state(), alone.state())
    assert loop.plant.timestep == 0.002
    assert loop.joint_names == load_model("two-link").joint_names


def test_initial_position() -> None:
    """A list arrives joint by joint, one number is for every joint, and home is zero."""
    assert built("run.initial_q=[0.1, -0.2, 0.3, -0.4, 0.5, -0.6]").initial_q.tolist() == [
        0.1,
        -0.2,
        0.3,
        -0.4,
        0.5,
        -0.6,
    ]
    assert built("run.initial_q=-0.7").initial_q.tolist() == [-0.7] * 6
    assert built("run.initial_q=home").initial_q.tolist() == built().initial_q.tolist() == [0.0] * 6


def test_controllers_keep_names_order_gains_and_options() -> None:
    """Each controller has its own law, name, options, and gains joint by joint, in the config's order."""
    first = "{name: b, law: smc, equivalent_control: false, switching: saturation, gains: {lam: 9, k: 0.2, phi: 0.4}}"
    second = "{name: a, law: pd, gains: {lam: [1, 2, 3, 4, 5, 6], kv: 7}}"
    b, a = built(f"controllers=[{first}, {second}]").controllers
    assert [(c.name, c.law.name) for c in (b, a)] == [("b", "smc"), ("a", "pd")]
    assert (b.gains.equivalent_control, b.gains.switching) == (0, 1)
    assert [x.tolist() for x in (b.gains.lam, b.gains.k, b.gains.phi)] == [[9.0] * 6, [0.2] * 6, [0.4] * 6]
    assert [x.tolist() for x in (a.gains.lam, a.gains.kv)] == [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [7.0] * 6]


SIX = np.array([1.0, 2.0, -3.0, 4.0, -5.0, 6.0])


@pytest.mark.parametrize(
    ("keys", "course"),
    [
        ("{kind: step, target: [1, 2, -3, 4, -5, 6], at: 0.3}", (np.arange(STEPS) >= 75) * 1.0),
        ("{kind: ramp, target: [1, 2, -3, 4, -5, 6], rise_time: 0.4}", np.minimum(STEP_TIMES / 0.4, 1.0)),
        (
            "{kind: quintic, target: [1, 2, -3, 4, -5, 6], rise_time: 0.4}",
            np.polyval([6.0, -15.0, 10.0, 0.0, 0.0, 0.0], np.minimum(STEP_TIMES / 0.4, 1.0)),
        ),
        (
            "{kind: sine, amplitude: [1, 2, -3, 4, -5, 6], frequency_hz: 0.7}",
            (1.0 - np.cos(2.0 * np.pi * 0.7 * STEP_TIMES)) / 2.0,
        ),
    ],
)
def test_reference_is_the_one_asked_for(keys: str, course: Array) -> None:
    """Each kind of motion runs from zero to each joint's own target, or over its own amplitude, in its own time."""
    q = built(f"reference={keys}").reference.q
    assert q == pytest.approx(np.outer(course, SIX), rel=1e-12, abs=1e-12)  # a handful of roundings of order 1e-16


def test_sine_has_a_frequency_for_each_joint() -> None:
    """Frequencies that differ between joints stay with their joints, and are not taken for amplitudes."""
    frequency = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    keys = "{kind: sine, amplitude: 2, frequency_hz: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]}"
    wanted = 1.0 - np.cos(2.0 * np.pi * np.outer(STEP_TIMES, frequency))
    assert built(f"reference={keys}").reference.q == pytest.approx(wanted, rel=1e-12, abs=1e-12)


NAMED = {
    "ideal": "{}",
    "fast": "{encoder_noise: 0.0001, velocity: differentiated, velocity_filter: 500, actuator_lag: 0.002}",
    "slow": "{encoder_noise: 0.0001, velocity: differentiated, velocity_filter: 200, actuator_lag: 0.008}",
}


@pytest.mark.parametrize("name", NAMED)
def test_a_named_chain_is_its_mapping(name: str) -> None:
    """The same noise and the same sensors and actuators, so that a run has the same bytes."""
    runs = []
    for chain in (name, NAMED[name]):
        experiment = parse(MINIMAL, *TIMING, f"chain={chain}")
        runs.append(run_experiment(experiment).runs["only"])
    assert runs[0].digest() == runs[1].digest()


def test_each_key_of_a_chain_is_its_own() -> None:
    """Noise, step, velocity, filter, delay and lag arrive where they belong; without a filter there is none."""
    text = "{encoder_noise: 0.1, quantisation: 0.2, velocity: differentiated, velocity_filter: 30}"
    chain = parse(MINIMAL, *TIMING, f"chain={text}", "chain.measurement_delay=0.04", "chain.actuator_lag=0.05").chain
    assert (
        chain.encoder_noise,
        chain.quantisation,
        chain.velocity_filter,
        chain.measurement_delay,
        chain.actuator_lag,
    ) == (
        0.1,
        0.2,
        30.0,
        0.04,
        0.05,
    )
    gains = {"exact": 1.0, "differentiated": 1.0}
    for velocity, gain in gains.items():
        assert parse(MINIMAL, f"chain={{velocity: {velocity}}}").chain.velocity_gain(0.001) == gain
    assert built("chain={quantisation: 0.1, measurement_delay: 0.004}").drawn.position is None
