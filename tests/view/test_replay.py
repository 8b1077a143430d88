"""The replay document holds the stored samples frame by frame."""

import dataclasses
import json

import numpy as np
import pytest

from torquebench.robot.puma560.puma import Puma560
from torquebench.sim.trajectory import SIGNALS, Outcome
from torquebench.video.job import Footage, Shot
from torquebench.view.replay import MOST_FRAMES, frames_of, replay_json

SHOTS = Shot("conventional", "smc", ""), Shot("pd", "pd", "")
FOOTAGE = Footage("view-test", "puma560", 0.001, 1.004, SHOTS)


def document(runs):
    """The replay of runs of the two controllers."""
    return json.loads(replay_json(FOOTAGE, runs, ["#000"], 1.0))


def signal(replay, controller, key):
    """A signal of one controller."""
    return np.array(replay["controllers"][controller][key])


@pytest.fixture(scope="module")
def stored(result):
    """The replay of the stored run."""
    return document(list(result.runs.values()))


def test_frames_are_the_samples(stored, result):
    """A frame each 10 ms, 101 for 1.004 s; the tool is where the analytic arm has it at that sample, within 10 um."""
    arm = Puma560("exact", "fitted")
    assert stored["count"] == 101
    assert stored["period"] == pytest.approx(0.01)
    for i, run in enumerate(result.runs.values()):
        tool = signal(stored, i, "tool").reshape(-1, 3)
        assert np.max(np.abs(tool - arm.forward_kinematics(run.q[::10])[:, :3, 3])) < 1e-5


def test_torque_and_error_are_those_until_the_next_frame(stored, result):
    """Least, greatest and mean of tau over the limit, and least and greatest error, of each frame's own ten samples."""
    limits = build_limits(result)
    for i, run in enumerate(result.runs.values()):
        torque = signal(stored, i, "torque").reshape(101, 6, 3)
        error = signal(stored, i, "error").reshape(101, 6, 2)
        for k in (0, 10, 57, 100):
            load, e = run.tau[10 * k : 10 * k + 10] / limits, (run.q_ref - run.q)[10 * k : 10 * k + 10]
            wanted = np.stack([load.min(axis=0), load.max(axis=0), load.mean(axis=0)], axis=1)
            assert np.max(np.abs(torque[k] - wanted)) < 1e-5
            assert np.max(np.abs(error[k] - np.stack([e.min(axis=0), e.max(axis=0)], axis=1))) < 1e-8
    assert np.ptp(signal(stored, 0, "torque").reshape(101, 6, 3)[50, :, :2], axis=1).max() > 0.1  # chattering is seen


def build_limits(result):
    """Torque limits of the arm [N m]."""
    return np.array(result.loop.plant.tau_max)


def test_the_ghost_is_the_reference(stored, result):
    """Before the step at rest, after it 0.6 rad on: the last link's body is where the arm is with q = q_ref."""
    bodies = np.array(stored["reference"]).reshape(101, -1, 7)
    assert np.array_equal(bodies[0], bodies[9])
    assert np.array_equal(bodies[11], bodies[100])
    moved = np.linalg.norm(bodies[11, -1, :3] - bodies[9, -1, :3])
    arm = Puma560("exact", "fitted")
    tip = np.linalg.norm(np.subtract(*(arm.forward_kinematics(np.full(6, x))[:3, 3] for x in (0.6, 0.0))))
    assert 0.5 * tip < moved < 1.5 * tip


def test_a_failed_run_ends_where_it_failed(result):
    """Its frames stop, its ending is given, what was not produced is left out, and the arm holds its last pose."""
    run = result.runs["conventional"]
    short = {name: getattr(run, name)[:313].copy() for name in ("t", *SIGNALS)}
    short["q"][305:] = np.nan
    short["tau"][312] = np.nan
    failed = dataclasses.replace(run, **short, outcome=Outcome.DIVERGED, failed_at=312, extra={})
    found = document([failed, result.runs["pd"]])
    tool = signal(found, 0, "tool").reshape(-1, 3)
    assert len(tool) == 32
    where = Puma560("exact", "fitted").forward_kinematics(run.q[304])[:3, 3]
    assert np.max(np.abs(tool[31] - where)) < 1e-5
    assert np.max(np.abs(signal(found, 0, "torque"))) <= 1.0
    assert [controller["ending"] for controller in found["controllers"]] == ["diverged at 0.312 s", ""]


def test_a_long_run_has_frames_further_apart():
    """At most 6000 frames, together as long as the run."""
    frames = frames_of(3_600_000, 0.001)
    assert frames.total <= MOST_FRAMES
    assert frames.total * frames.period == pytest.approx(3600.0)
