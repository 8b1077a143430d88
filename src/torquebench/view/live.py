"""Feeding a page: from a stored run at once, or from runs in progress, in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.sim.result import Motion
from torquebench.sim.trajectory import Trajectory
from torquebench.view.arm import Arm
from torquebench.view.feed import Feed
from torquebench.view.replay import Grid, ended_message, frames_message, grid, reference_message, scene_message

EVERY = 0.1
"""Time between looks at a run in progress [s]."""
POSES = 100
"""Poses of each run by which a camera is placed, where the arm's files have none."""
CHUNK = 500
"""Frames of one message at most."""


class PageSubject(NamedTuple):
    """What a page shows, but for the motions, which may not be stored yet."""

    title: str
    model: str
    """Name of the arm."""
    control_period: float
    """Time between samples [s]."""
    controllers: tuple[tuple[str, str], ...]
    """Name and note of each."""


def feed_stored(
    feed: Feed, subject: PageSubject, runs: Sequence[Trajectory], colours: Sequence[str], speed: float
) -> None:
    """Fill a feed with stored runs, and close it.

    Args:
        feed: What is filled.
        subject: What is shown.
        runs: Trajectory of each controller.
        colours: As of `scene_message`.
        speed: Simulated seconds shown in one second, to begin with.
    """
    longest = max(runs, key=lambda run: len(run.t))
    frames = grid(len(longest.t), subject.control_period)
    every = [max(1, len(run.t) // POSES) for run in runs]
    poses = [x[::step] for run, step in zip(runs, every, strict=True) for x in (run.q, run.q_ref)]
    arm = Arm(subject.model, np.nan_to_num(np.concatenate(poses)))
    feed.add(scene_message(arm, frames, subject.title, subject.controllers, colours, speed, live=False))
    feed.add(reference_message(arm, frames, longest.q_ref))
    for controller, run in enumerate(runs):
        _send(feed, arm, frames, controller, (run.q, run.q_ref, run.tau), 0, -(-len(run.t) // frames.every))
        feed.add(ended_message(controller, run.ending))
    feed.close()


def _send(
    feed: Feed, arm: Arm, frames: Grid, controller: int, signals: tuple[Array, Array, Array], first: int, last: int
) -> None:
    for start in range(first, last, CHUNK):
        feed.add(frames_message(arm, frames, controller, *signals, start, min(start + CHUNK, last)))


@dataclass
class _Running:
    """One controller's run: what the simulation last told of it, and what has been sent."""

    signals: tuple[Array, Array, Array] | None = None
    samples: int = 0
    ending: str | None = None
    sent: int = 0


class Live:
    """Feeds runs as they are simulated; a context manager, which closes the feed.

    The simulation's thread only notes how far it is (`watch`, `finished`); this thread turns samples into frames, each
    once. So a run is slowed by a fixed amount of work for each second simulated, and nothing that it computes changes.

    Args:
        feed: What is fed.
        subject: What will be shown.
        reference: The desired motion of the whole run, (N, n) [rad].
        colours: As of `scene_message`.
        speed: Simulated seconds shown in one second, to begin with.

    Raises:
        ModelError: the arm cannot be drawn.
    """

    def __init__(
        self, feed: Feed, subject: PageSubject, reference: Array, colours: Sequence[str], speed: float
    ) -> None:
        self._feed, self._runs = feed, {name: _Running() for name, _ in subject.controllers}
        self._frames = grid(len(reference), subject.control_period)
        self._arm = Arm(subject.model, reference[:: max(1, len(reference) // POSES)])
        feed.add(scene_message(self._arm, self._frames, subject.title, subject.controllers, colours, speed, live=True))
        feed.add(reference_message(self._arm, self._frames, reference))
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._follow, daemon=True)

    def __enter__(self) -> Live:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def watch(self, name: str, k: int, motion: Motion) -> None:
        """Note that controller `name` has been simulated up to control instant `k`."""
        run = self._runs[name]
        if run.signals is None:
            run.signals = motion.q, motion.q_ref, motion.tau
        run.samples = k + 1

    def finished(self, name: str, trajectory: Trajectory) -> None:
        """Note that controller `name` has ended with `trajectory`."""
        run = self._runs[name]
        run.signals = trajectory.q, trajectory.q_ref, trajectory.tau
        run.samples = len(trajectory.t)
        run.ending = trajectory.ending

    def _follow(self) -> None:
        while not self._over.wait(EVERY):
            self._look()
            if all(run.sent < 0 for run in self._runs.values()):
                break
        self._look()
        self._feed.close()

    def _look(self) -> None:
        """Send what has become known."""
        for controller, run in enumerate(self._runs.values()):
            end, samples, signals = run.ending, run.samples, run.signals  # in this order: `finished` sets `ending` last
            if signals is None or run.sent < 0:
                continue
            known = samples // self._frames.every if end is None else -(-samples // self._frames.every)
            q, q_ref, tau = (x[:samples] for x in signals)
            _send(self._feed, self._arm, self._frames, controller, (q, q_ref, tau), run.sent, known)
            run.sent = known
            if end is not None:
                self._feed.add(ended_message(controller, end))
                run.sent = -1
