"""Experiments as Gymnasium environments: the checker passes, and a law driven through one leaves its run's bytes."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.arms import two_link
from tests.user_files import load
from torquebench.dialect import complaints, read_file
from torquebench.errors import ResultError
from torquebench.experiment.build import build
from torquebench.gym import ERROR, FAILED, ID, TorqueEnv
from torquebench.kernel.twin import python_numbers
from torquebench.laws import find_law
from torquebench.references import Reference
from torquebench.results import run_experiment
from torquebench.robot.flat_model import own_copy
from torquebench.sim.interpreted import Call

ROOT = Path(__file__).parents[1]
SHORT = {"run.duration": 0.6, "run.metrics_from": 0.1}
RUNS: dict[str, dict[str, Any]] = {
    "exact": {},
    "measured, late, noisy": {"chain": "slow", "chain.measurement_delay": 0.002, "disturbances": "30 %"},
    "changing": {
        "plant.payload": {"mass": 2, "at": 0.2},
        "plant.lock": {"joint": 4, "at": 0.3},
        "chain": {"jitter": 0.001, "derating": {"at": 0.1, "limit": 0.5}},
    },
}


def driven(env: TorqueEnv, law: str, seed: int) -> Any:
    """Return the trajectory of an episode in which a law of the experiment is asked for every torque."""
    experiment = env.experiment.with_({"run.seed": seed, "run.draw": 0})
    loop, n = build(experiment), env.experiment.n
    controller = next(one for one in loop.controllers if one.name == law)
    belief = own_copy(loop.model.flat, control_period=experiment.run.control_period)
    call = Call(controller.law, controller.gains, belief, controller.law.new_memory(n))
    seen, _ = env.reset(seed=seed)
    over = False
    while not over:
        q, qd, *ref = seen[:-1].reshape(5, n)
        torque, _, _ = call(python_numbers(seen)[-1], q, qd, Reference(*ref))
        seen, _, failed, ended, _ = env.step(torque)
        over = failed or ended
    return env.trajectory()


@pytest.mark.parametrize("name", RUNS)
def test_a_law_through_the_environment_leaves_the_bytes_of_its_run(name: str) -> None:
    """Every signal of every instant, with noise, delay, late commands and a plant that changes: 0 differing bytes."""
    env = TorqueEnv("fig9-chattering", SHORT | RUNS[name], scaled=False)
    alone = env.experiment.with_({"run.seed": 5, "controllers": ["band"]})
    run = run_experiment(alone, path="python").trajectories["band"]
    assert driven(env, "band", 5).tau.tobytes() == run.tau.tobytes()
    mine = env.trajectory()
    for signal in ("q", "qd", "q_meas", "qd_meas", "tau_law", "tau_applied"):
        assert getattr(mine, signal).tobytes() == getattr(run, signal).tobytes()
    assert mine.outcome == run.outcome


@pytest.mark.filterwarnings("ignore::UserWarning")  # observations have no bounds
def test_gymnasium_s_checker_passes() -> None:
    """The checker finds nothing; and `gymnasium.make` makes it under its name."""
    check_env(TorqueEnv("fig9-chattering", SHORT | {"chain": "slow"}), skip_render_check=True)
    env = gymnasium.make(ID, experiment="fig9-chattering", changes=SHORT)
    assert isinstance(env.unwrapped, TorqueEnv)


def test_seeds_and_draws() -> None:
    """One seed, one noise; a reset without a seed is the next draw of it, the numbers of run.draw in a config."""
    env = TorqueEnv("fig9-chattering", SHORT | {"chain": "fast"})
    first, info = env.reset(seed=3)
    assert info == {"seed": 3, "draw": 0}
    second, info = env.reset()
    assert info == {"seed": 3, "draw": 1}
    assert not np.array_equal(first, second)
    assert np.array_equal(env.reset(seed=3)[0], first)
    own = TorqueEnv("fig9-chattering", SHORT | {"chain": "fast", "run.seed": 3, "run.draw": 1})
    assert np.array_equal(own.reset()[0], second)


def test_several_at_once() -> None:
    """Those of a vector environment see what each sees by itself, with the seeds that follow one another."""
    changes = SHORT | {"chain": "slow"}
    envs = gymnasium.make_vec(ID, num_envs=2, vectorization_mode="sync", experiment="fig9-chattering", changes=changes)
    seen, _ = envs.reset(seed=8)
    action = np.full((2, 6), 0.1, np.float32)
    after = envs.step(action)[0]
    for i in range(2):
        own = TorqueEnv("fig9-chattering", changes)
        assert np.array_equal(own.reset(seed=8 + i)[0], seen[i])
        assert np.array_equal(own.step(action[i])[0], after[i])
    envs.close()


def test_reward_and_end() -> None:
    """The sum is -N times the mean square of error and command's change; N steps end it, and one more is refused."""
    env = TorqueEnv("fig9-chattering", SHORT)
    seen, _ = env.reset(seed=1)
    rng, total, ended, count = np.random.default_rng(0), 0.0, False, 0
    while not ended:
        last = seen
        seen, reward, failed, ended, info = env.step(rng.uniform(-0.1, 0.1, 6).astype(np.float32))
        total, count = total + reward, count + 1
        assert not failed
    assert count == 600
    assert info["outcome"] == "COMPLETED"
    assert np.array_equal(seen, last)  # there is no instant after the last one
    run = env.trajectory()
    change = np.diff(run.tau, axis=0, prepend=run.tau[:1]) / env.tau_max
    wanted = -np.mean(((run.q_ref - run.q) / ERROR) ** 2) - np.mean(change**2)
    assert total == pytest.approx(600 * wanted, rel=1e-9)
    with pytest.raises(ResultError, match="reset first"):
        env.step(np.zeros(6, np.float32))


def test_a_torque_that_is_none_ends_it() -> None:
    """What fails a run terminates its episode, and costs what is left of it."""
    env = TorqueEnv("fig9-chattering", SHORT)
    env.reset(seed=1)
    env.step(np.zeros(6, np.float32))
    with pytest.raises(ResultError, match="not over"):
        env.trajectory()
    _, reward, failed, ended, info = env.step(np.full(6, np.nan, np.float32))
    assert (failed, ended, info["outcome"]) == (True, False, "BAD_TORQUE")
    assert reward == -FAILED * 599
    assert env.trajectory().failed_at == 1


def test_a_trained_net_is_written_out_as_a_law(tmp_path: Path) -> None:
    """The file that the training script writes declares a law in the dialect, and nothing else, with the net's torque.

    Weights stand there with six digits: 1e-5 of the torque.
    """
    script, rng = runpy.run_path(str(ROOT / "examples" / "train_policy.py")), np.random.default_rng(2)
    weights, arm = rng.normal(size=script["SIZE"]), two_link()
    text = script["law_file"](weights, "paper/sine")
    committed = (ROOT / "examples" / "learned_policy.py").read_text(encoding="utf-8")
    numbers = r"[-+]?\s*\d[\d.]*(e-?\d+)?"
    assert re.sub(r"[-+\s]", "", re.sub(numbers, "", text)) == re.sub(r"[-+\s]", "", re.sub(numbers, "", committed))
    assert read_file(text) == read_file(committed) == []
    load(tmp_path, text.replace("learned-policy", "learned-in-a-test"))
    law = find_law("learned-in-a-test")
    assert complaints(law) == ()
    q, qd, q_ref, qd_ref, integral = rng.normal(scale=0.1, size=(5, 2))
    memory, tau = law.new_memory(2), np.zeros(2)
    memory.integral[:] = integral
    reference = Reference(q_ref, qd_ref, np.zeros(2))
    law.function(law.pack_gains(2, {"lam": 15}, {}), arm.flat, 0.0, q, qd, reference, memory, tau)
    first, last = weights[:12].reshape(4, 3), weights[12:]
    inputs = np.stack([15.0 * (q_ref - q), qd_ref - qd, 225.0 * integral])
    assert tau == pytest.approx(15.0 * arm.flat.inertia_scale * (last @ np.tanh(first @ inputs)), rel=1e-5)


def test_the_page_s_example_runs() -> None:
    """docs/learned-policies.md does what it shows."""
    page = (ROOT / "docs" / "learned-policies.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(block, "docs/learned-policies.md", "exec"), names)
    assert names["envs"].reset(seed=0)[0].shape == (8, 31)
    names["envs"].close()
