"""Many closed loops on several threads: the same bytes in the same order, whatever the number of threads."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.arms import pack
from tests.sampled import sampled_trial
from tests.sim import faulty_laws
from tests.sim.protocol import CONDITIONS, HOME, REFERENCES, belief_of, plant_of, signals, variants
from torquebench.chain import Drawn
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.session import SampledTrial, Session
from torquebench.sim.simulate import AHEAD, Workers, simulate_many
from torquebench.sim.trajectory import Outcome, Trajectory

ROOT = Path(__file__).resolve().parents[2]
WORKERS = (1, 2, 4, 8)
LONGEST = 300


def trials(plant: str, count: int = 32) -> list[SampledTrial]:
    """Return trials of laws of all kinds and every chain; each fifth has a faulty law, each seventh a huge push."""
    n, every, found = plant_of(plant).n, variants(), []
    for i in range(count):
        n_steps = LONGEST - 37 * (i % 6)
        noise, push = (x[:n_steps].copy() for x in signals(n, LONGEST))
        variant = every[i * len(every) // count]
        controller = variant.controller(n)
        if i % 5 == 4:
            controller = faulty_laws.controller(faulty_laws.NOT_A_NUMBER, n, at=0.001 * (20 + i), joint=i % n)
        if i % 7 == 6:
            push[40 + i, i % n] = 1e300
        chain, noisy, *_ = list(CONDITIONS.values())[i % len(CONDITIONS)]
        found.append(
            sampled_trial(
                controller,
                belief_of(plant, variant.law),
                list(REFERENCES.values())[i % 4](n),
                0.001 * n_steps,
                chain=chain,
                drawn=Drawn(noise if noisy else None),
                disturbance=push,
                initial_q=np.array(HOME[:n]) * (1 + 0.01 * i),
            )
        )
    return found


def alone(plant: str, trial: SampledTrial, path: Any = "auto") -> Trajectory:
    """Run one trial on a plant of its own, without `simulate_many`."""
    return Session().run(plant_of(plant).replica(), trial, path)


@pytest.mark.parametrize("path", ["native", "python"])
@pytest.mark.parametrize("plant", ["mujoco puma560", "analytic puma560", "mujoco two-link"])
def test_results_do_not_depend_on_the_number_of_threads(plant: str, path: Any, figure: Any) -> None:
    """1, 2, 4 and 8 threads, twice each: the digests of each trial run alone, in the trials' order.

    Interpreted, where threads take turns anyway, 2 and 8 once.
    """
    chosen = trials(plant, 32 if path == "native" else 6)
    wanted = [alone(plant, trial, path) for trial in chosen]
    digests = [run.digest() for run in wanted]
    apart = 0
    for workers in WORKERS + WORKERS if path == "native" else (2, 8):
        runs = list(simulate_many(plant_of(plant), chosen, workers=workers, path=path))
        assert {run.path for run in runs} == {path}
        apart += sum(run.digest() != digest for run, digest in zip(runs, digests, strict=True))
    figure(f"runs that depend on the number of threads, {plant}, {path}", apart, "0")
    assert apart == 0
    assert len(set(digests)) == len(chosen)  # so that an exchange of two would show


def test_a_failed_run_stops_alone() -> None:
    """Each failing trial ends at its own instant; the others complete; the order is the trials'."""
    chosen = trials("mujoco puma560")
    for i, run in enumerate(simulate_many(plant_of("mujoco puma560"), chosen, workers=4, path="native")):
        at = min(20 + i if i % 5 == 4 else LONGEST, 40 + i if i % 7 == 6 else LONGEST)
        if at == LONGEST:
            assert run.completed
            assert len(run.t) == LONGEST - 37 * (i % 6)
        else:
            assert run.failed_at == at
            assert run.outcome is (Outcome.BAD_TORQUE if i % 5 == 4 else Outcome.DIVERGED)


def arrays_of(thing: Any) -> Iterator[np.ndarray]:
    """Yield every array reachable through the fields of a structure or the attributes of a MuJoCo object."""
    if isinstance(thing, np.ndarray):
        yield thing
    elif hasattr(thing, "_fields"):
        for name in thing._fields:
            yield from arrays_of(getattr(thing, name))
    elif hasattr(thing, "__dataclass_fields__"):
        for name in thing.__dataclass_fields__:
            yield from arrays_of(getattr(thing, name))
    elif type(thing).__module__.startswith("mujoco"):
        for name in dir(thing):
            if not name.startswith("_"):
                value = getattr(thing, name)
                if isinstance(value, np.ndarray):
                    yield value


@pytest.mark.parametrize("name", ["mujoco puma560", "mujoco two-link", "analytic puma560", "analytic corrected"])
def test_a_replica_shares_nothing_that_is_written(name: str) -> None:
    """Neither arrays nor MuJoCo's structures; stepping the one leaves the other where it was; both move alike."""
    first = plant_of(name).replica()
    second = first.replica()
    held = [
        [array for thing in (plant.native().structure, *vars(plant).values()) for array in arrays_of(thing)]
        for plant in (first, second)
    ]
    assert len(held[0]) > 10
    for a, b in itertools.product(*held):
        if a.size and b.size and np.shares_memory(a, b):
            assert a is first.tau_max or not a.flags.writeable
    q = np.array(HOME[: first.n])
    for plant in (first, second):
        plant.reset(q, -q)
    before = [x.tobytes() for x in second.state()]
    first.step(np.ones(first.n), 10)
    assert [x.tobytes() for x in second.state()] == before
    second.step(np.ones(first.n), 10)
    assert [x.tobytes() for x in first.state()] == [x.tobytes() for x in second.state()] != before


def test_a_replica_is_of_the_plant_as_it_is() -> None:
    """A payload, a time step, an integrator and limits set on a plant are its replica's too."""
    plant = MujocoPlant("puma560", 0.0005, "euler")
    plant._m.body_mass[-1] += 2.0
    plant.tau_max = 0.5 * plant.tau_max
    twin = plant.replica()
    assert (twin.timestep, twin.tau_max.tolist()) == (0.0005, plant.tau_max.tolist())
    for p in (plant, twin):
        p.reset(np.array(HOME), np.zeros(6))
        p.step(np.ones(6), 100)
    assert [x.tobytes() for x in plant.state()] == [x.tobytes() for x in twin.state()]


def in_time(work: Callable[[], Any]) -> Any:
    """Return what `work` returns, or fail when that takes more than a minute."""
    box: list[Any] = []
    thread = threading.Thread(target=lambda: box.append(work()), daemon=True)
    thread.start()
    thread.join(60.0)
    assert not thread.is_alive(), "hangs"
    return box[0]


@pytest.mark.parametrize("workers", WORKERS)
def test_stopping_early_stops_everything(workers: int) -> None:
    """Closed after three results, the generator ends, takes few trials before their turn, and leaves no thread."""
    taken: list[int] = []
    chosen = trials("mujoco two-link", 8)

    def endless() -> Iterator[SampledTrial]:
        for i in itertools.count():
            taken.append(i)
            yield chosen[i % len(chosen)]

    def work() -> list[Trajectory]:
        results = simulate_many(plant_of("mujoco two-link"), endless(), workers=workers)
        first = list(itertools.islice(results, 3))
        results.close()
        return first

    before = threading.active_count()
    runs = in_time(work)
    assert [run.digest() for run in runs] == [alone("mujoco two-link", trial).digest() for trial in chosen[:3]]
    assert len(taken) <= 3 + AHEAD * workers
    assert threading.active_count() <= before


@pytest.mark.parametrize("workers", WORKERS)
def test_a_trial_that_does_not_fit_raises_in_its_turn(workers: int) -> None:
    """The results before it come first; then its ValueError; a source of trials that fails does so likewise."""
    good = trials("analytic two-link", 6)
    bad = sampled_trial(pack("pd", 3, lam=8, kv=12), good[0].model, good[0].reference, 0.1)

    def failing() -> Iterator[SampledTrial]:
        yield from good
        raise LookupError("no more draws")

    def work(source: Any, error: type[Exception]) -> int:
        results, count = simulate_many(plant_of("analytic two-link"), source, workers=workers), 0
        try:
            for _ in results:
                count += 1
        except error as raised:
            assert re.search("has gains for 3 joints, the plant has 2|no more draws", str(raised))  # noqa: PT017
            return count
        raise AssertionError("nothing was raised")

    assert in_time(lambda: work([*good, bad, *good], ValueError)) == len(good)
    # a source that fails has the pool wait for what is under way; what it gave before may be lost, no more
    assert in_time(lambda: work(failing(), LookupError)) <= len(good)


@pytest.mark.parametrize("workers", WORKERS)
def test_workers_serve_one_batch_after_another(workers: int) -> None:
    """Batches on the same threads, one of them given up half-way and one with failures: each run as it is alone."""
    chosen = trials("mujoco two-link", 12)
    wanted = [alone("mujoco two-link", trial).digest() for trial in chosen]
    with Workers(plant_of("mujoco two-link"), workers) as own:
        half = own.simulate(chosen)
        assert next(half).digest() == wanted[0]
        half.close()  # type: ignore[attr-defined]
        for _ in range(3):
            assert [run.digest() for run in own.simulate(chosen)] == wanted


@pytest.mark.parametrize("workers", [0, -1])
def test_no_threads_are_refused(workers: int) -> None:
    """The number is named."""
    with pytest.raises(ValueError, match=f"workers is {workers}, wanted at least 1"):
        next(simulate_many(plant_of("analytic two-link"), [], workers=workers))


def test_no_trials_no_results() -> None:
    """An empty source is an empty result, with one thread and with several."""
    for workers in WORKERS:
        assert list(simulate_many(plant_of("analytic two-link"), [], workers=workers)) == []


FIRST_OF_ALL = """
from tests.sim.protocol import plant_of
from tests.sim.test_native_threads import trials
from torquebench.sim.simulate import simulate_many
for run in simulate_many(plant_of("mujoco two-link"), trials("mujoco two-link", 16), workers=8, path="native"):
    print(run.digest())
"""


def test_threads_may_be_the_first_to_compile() -> None:
    """In a new process eight threads load or compile the loop, the plant and the laws at once: the same digests."""
    wanted = [alone("mujoco two-link", trial).digest() for trial in trials("mujoco two-link", 16)]
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", FIRST_OF_ALL],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env=dict(os.environ),
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == wanted
