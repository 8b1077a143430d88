"""What a page is fed: the stored samples frame by frame, the same live as stored, and nothing changes by watching."""

import dataclasses
import json

import numpy as np
import pytest

from torquebench.experiment.build import build
from torquebench.experiment.run import run_experiment
from torquebench.robot.puma560.puma import Puma560
from torquebench.sim.trajectory import SIGNALS, Outcome
from torquebench.view.feed import Feed
from torquebench.view.live import Live, PageSubject, feed_stored
from torquebench.view.replay import MOST_FRAMES, grid

SUBJECT = PageSubject("view-test", "puma560", 0.001, (("conventional", "smc"), ("pd", "pd")))


def messages(feed):
    """All messages of a feed, of one kind after the other."""
    found = {}
    for message in json.loads(feed.since(0, 0.0)):
        found.setdefault(message["kind"], []).append(message)
    return found


def joined(found, controller, key):
    """A signal of one controller over all messages."""
    parts = sorted((m for m in found["frames"] if m["controller"] == controller), key=lambda m: m["first"])
    return np.concatenate([m[key] for m in parts])


@pytest.fixture(scope="module")
def stored(result):
    """The messages of the stored run."""
    feed = Feed()
    feed_stored(feed, SUBJECT, list(result.runs.values()), ["#000"], 1.0)
    return messages(feed)


def test_frames_are_the_samples(stored, result):
    """A frame each 10 ms, 101 for 1.004 s; the tool is where the analytic arm has it at that sample, within 10 um."""
    arm = Puma560("exact", "fitted")
    assert stored["scene"][0]["count"] == 101
    assert stored["scene"][0]["period"] == pytest.approx(0.01)
    for i, run in enumerate(result.runs.values()):
        tool = joined(stored, i, "tool").reshape(-1, 3)
        assert np.max(np.abs(tool - arm.forward_kinematics(run.q[::10])[:, :3, 3])) < 1e-5


def test_torque_and_error_are_those_until_the_next_frame(stored, result):
    """Least, greatest and mean of tau over the limit, and least and greatest error, of each frame's own ten samples."""
    limits = build_limits(result)
    for i, run in enumerate(result.runs.values()):
        torque = joined(stored, i, "torque").reshape(101, 6, 3)
        error = joined(stored, i, "error").reshape(101, 6, 2)
        for k in (0, 10, 57, 100):
            load, e = run.tau[10 * k : 10 * k + 10] / limits, (run.q_ref - run.q)[10 * k : 10 * k + 10]
            wanted = np.stack([load.min(axis=0), load.max(axis=0), load.mean(axis=0)], axis=1)
            assert np.max(np.abs(torque[k] - wanted)) < 1e-5
            assert np.max(np.abs(error[k] - np.stack([e.min(axis=0), e.max(axis=0)], axis=1))) < 1e-8
    assert np.ptp(joined(stored, 0, "torque").reshape(101, 6, 3)[50, :, :2], axis=1).max() > 0.1  # chattering is seen


def build_limits(result):
    """Torque limits of the arm [N m]."""
    return np.array(result.loop.plant.tau_max)


def test_the_ghost_is_the_reference(stored, result):
    """Before the step at rest, after it 0.6 rad on: the last link's body is where the arm is with q = q_ref."""
    bodies = np.array(stored["reference"][0]["bodies"]).reshape(101, -1, 7)
    assert np.array_equal(bodies[0], bodies[9])
    assert np.array_equal(bodies[11], bodies[100])
    moved = np.linalg.norm(bodies[11, -1, :3] - bodies[9, -1, :3])
    arm = Puma560("exact", "fitted")
    tip = np.linalg.norm(np.subtract(*(arm.forward_kinematics(np.full(6, x))[:3, 3] for x in (0.6, 0.0))))
    assert 0.5 * tip < moved < 1.5 * tip


def test_a_failed_run_ends_where_it_failed(result):
    """Its frames stop, its ending is told, what was not produced is left out, and the arm holds its last pose."""
    run = result.runs["conventional"]
    short = {name: getattr(run, name)[:313].copy() for name in ("t", *SIGNALS)}
    short["q"][305:] = np.nan
    short["tau"][312] = np.nan
    failed = dataclasses.replace(run, **short, outcome=Outcome.DIVERGED, failed_at=312, extra={})
    feed = Feed()
    feed_stored(feed, SUBJECT, [failed, result.runs["pd"]], ["#000"], 1.0)
    found = messages(feed)
    tool = joined(found, 0, "tool").reshape(-1, 3)
    assert len(tool) == 32
    where = Puma560("exact", "fitted").forward_kinematics(run.q[304])[:3, 3]
    assert np.max(np.abs(tool[31] - where)) < 1e-5
    assert np.max(np.abs(joined(found, 0, "torque"))) <= 1.0
    assert [m["ending"] for m in found["ended"]] == ["diverged at 0.312 s", ""]


@pytest.mark.parametrize("path", ["auto", "python"])
def test_watching_changes_nothing(experiment, result, path):
    """The same bytes of every trajectory with and without an audience, compiled and interpreted."""
    feed, loop = Feed(), build(experiment)
    with Live(feed, SUBJECT, loop.reference.q, ["#000"], 1.0) as live:
        watched = run_experiment(experiment, loop, path=path, watch=live.watch, finished=live.finished)
    for name, run in result.runs.items():
        again = dataclasses.replace(watched.runs[name], path=run.path, path_reason=run.path_reason)
        assert again.to_bytes() == run.to_bytes()


def test_live_shows_what_stored_shows(experiment, stored):
    """Whatever was sent while the run went on, all of it together is what the stored run gives, and then the end."""
    feed, loop = Feed(), build(experiment)
    with Live(feed, SUBJECT, loop.reference.q, ["#000"], 1.0) as live:
        run_experiment(experiment, loop, path="python", watch=live.watch, finished=live.finished)
    found = messages(feed)
    for i in range(2):
        for key in ("bodies", "tool", "torque", "error"):
            assert np.array_equal(joined(found, i, key), joined(stored, i, key))
    assert found["reference"] == stored["reference"]
    assert found["ended"] == stored["ended"]
    assert json.loads(feed.since(len(feed) - 1, 0.0)) == [{"kind": "end"}]


def test_a_run_in_progress_is_told(experiment):
    """On the readable path at every instant, with the samples up to it there and none that can be written to."""
    loop, seen = build(experiment), []

    def watch(name, k, motion):
        seen.append((name, k, motion.q[k].copy(), motion))

    done = run_experiment(experiment, loop, path="python", watch=watch)
    assert [(name, k) for name, k, *_ in seen] == [(name, k) for name in done.runs for k in range(1004)]
    for name, k, q, motion in seen[::100]:
        assert np.array_equal(q, done.runs[name].q[k])
        assert not any(array.flags.writeable for array in motion)
        assert np.array_equal(motion.q_ref, done.runs[name].q_ref)


def test_a_long_run_has_frames_further_apart():
    """At most 6000 frames, together as long as the run."""
    frames = grid(3_600_000, 0.001)
    assert frames.total <= MOST_FRAMES
    assert frames.total * frames.period == pytest.approx(3600.0)
