"""Paths of the tool: the tool is where the path is, rates are derivatives, and what no arm can follow is refused."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from PIL import ImageColor

from tests.experiment.examples import TOOL
from tests.video.films import camera_of_scene, pixel
from torquebench.errors import ConfigError
from torquebench.experiment.config import parse_experiment
from torquebench.experiment.dump import dump_experiment
from torquebench.experiment.run import run_experiment
from torquebench.experiment.schema import Video
from torquebench.kernel import Array
from torquebench.keys import Key
from torquebench.metrics import from_joints, measured, record_of
from torquebench.references import (
    ClosedToolPath,
    Quintic,
    ToolCircle,
    ToolLemniscate,
    ToolLine,
    ToolWaypoints,
    from_samples,
)
from torquebench.robot import RobotModel, load_model
from torquebench.robot.flat_model import HINGE, SLIDE, rigid_model
from torquebench.robot.inverse_kinematics import PathError, tool_frames

START = (0.0, -1.0, 3.3, 0.0, 0.84, 0.0)
"""The PUMA with its tool down, before it."""
WAY = ((0.1, 0.0, 0.0), (0.1, 0.0, 0.0), (0.1, -0.15, 0.1))


@dataclass(frozen=True, kw_only=True)
class Ellipse(ClosedToolPath):
    """A user's shape."""

    axes: Annotated[tuple[float, float], Key("Half axes", "m")]

    def along(self, u: Array) -> Array:
        """Return points of the ellipse."""
        angle = 2 * np.pi * u
        return np.stack([self.axes[0] * (np.cos(angle) - 1), 0 * u, self.axes[1] * np.sin(angle)], axis=1)


def rounds(t: Array, period: float) -> Array:
    """Rounds after `t` by quadrature: the rate 10x^3 - 15x^4 + 6x^5 up to half a period, then 1 / period."""
    nodes, weights = np.polynomial.legendre.leggauss(5)  # exact for degree nine
    ends = np.minimum(t, period / 2)
    x = np.multiply.outer(ends, (nodes + 1) / 2) / (period / 2)
    ramp = (10 * x**3 - 15 * x**4 + 6 * x**5) @ weights / 2 * ends
    return (ramp + np.maximum(t - period / 2, 0)) / period


def random_arm(n: int, slide: int | None = None) -> RobotModel:
    """An arm of `n` joints in no special position to each other."""
    rng = np.random.default_rng(n)
    turns = np.linalg.qr(rng.normal(size=(n + 1, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    eye, ones = np.tile(np.eye(3), (n, 1, 1)), np.ones(n)
    flat = rigid_model(
        kind=[SLIDE if i == slide else HINGE for i in range(n)],
        rotation=turns[:n],
        offset=rng.uniform(-0.3, 0.3, (n, 3)),
        mass=ones,
        com=np.zeros((n, 3)),
        inertia=eye,
        armature=ones,
        gravity=np.zeros(3),
        tool_rotation=turns[n],
        tool_offset=np.array([0.1, 0.0, 0.2]),
        tau_max=ones,
        inertia_scale=ones,
    )
    return RobotModel("random", tuple(f"joint{i + 1}" for i in range(n)), flat)


def motion_of(path: Any, arm: RobotModel, t: Array) -> Any:
    """The path's motion of the arm's joints at some times."""
    return path.on_arm(arm).sample(t, arm.n)


PUMA = load_model("puma560")
SHAPES: dict[str, tuple[Any, Any]] = {
    "line": (
        ToolLine(to=(0.1, -0.2, 0.15), period=2.0, start=START),
        lambda u: np.outer(np.sin(math.pi * u) ** 2, [0.1, -0.2, 0.15]),
    ),
    "circle": (
        ToolCircle(radius=0.15, period=2.0, start=START, plane="yz"),
        lambda u: 0.15 * np.stack([0 * u, np.cos(2 * math.pi * u) - 1, np.sin(2 * math.pi * u)], axis=1),
    ),
    "lemniscate": (
        ToolLemniscate(width=0.4, period=2.0, start=START, plane="xy"),
        lambda u: 0.2 * np.stack([np.sin(2 * math.pi * u), np.sin(4 * math.pi * u) / 2, 0 * u], axis=1),
    ),
    "own": (Ellipse(axes=(0.1, 0.2), period=2.0, start=START), Ellipse(axes=(0.1, 0.2), period=2.0, start=START).along),
}
"""Paths, and where they are after some rounds."""


@pytest.mark.parametrize("orientation", ["kept", "free"])
@pytest.mark.parametrize("name", SHAPES)
def test_the_tool_is_on_the_path(name: str, orientation: str) -> None:
    """Forward kinematics of q is the path to 1e-9 m at any instant, 1e-10 at knots; kept orientation to 1e-9."""
    path, places = SHAPES[name]
    path = type(path)(**{**{k: v for k, v in vars(path).items() if k != "_solved"}, "orientation": orientation})
    begin = PUMA.forward_kinematics(START)
    t = np.linspace(0.0, 5.0, 997)
    pose = PUMA.forward_kinematics(motion_of(path, PUMA, path.approach + t).q)
    assert np.max(np.abs(pose[:, :3, 3] - begin[:3, 3] - places(rounds(t, 2.0)))) < 1e-9
    if orientation == "kept":
        # of the matrix's elements, each at most the angle
        assert np.max(np.abs(pose[:, :3, :3] - begin[:3, :3])) < 1e-9
    (part,) = path.on_arm(PUMA).parts
    knots = np.arange(65) / 64
    at_knots = PUMA.forward_kinematics(part.at(knots)[0])
    assert np.max(np.abs(at_knots[:, :3, 3] - begin[:3, 3] - places(knots))) < 1e-10


def test_waypoints_are_passed_at_rest_on_straight_lines() -> None:
    """The tool is at each point when 1.875 length / speed has passed, at rest; between two it is on their line."""
    path = ToolWaypoints(points=WAY, speed=0.2, start=START, approach=0.5)
    begin = PUMA.forward_kinematics(START)[:3, 3]
    points = np.array([[0.0, 0.0, 0.0], WAY[0], WAY[2]])
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    times = 0.5 + np.cumsum([0.0, *(1.875 * lengths / 0.2)])
    found = motion_of(path, PUMA, np.append(times, times[-1] + 1.0))
    places = PUMA.forward_kinematics(found.q)[:, :3, 3] - begin
    assert places == pytest.approx(np.vstack([points, points[-1]]), abs=1e-9)
    assert np.max(np.abs(found.qd)) < 1e-12
    assert np.max(np.abs(found.qdd)) < 1e-9
    h = 1e-4
    t = np.arange(times[1] + h, times[2], h)
    q = PUMA.forward_kinematics(motion_of(path, PUMA, t).q)[:, :3, 3] - begin - points[1]
    along = points[2] - points[1]
    assert np.max(np.linalg.norm(np.cross(q, along / lengths[1]), axis=1)) < 1e-9
    # the greatest speed, by differences whose error is h^2 / 6 times a third derivative of 60 x 0.2 m / (1.7 s)^3
    assert np.max(np.linalg.norm(q[2:] - q[:-2], axis=1)) / (2 * h) == pytest.approx(0.2, rel=1e-6)


@pytest.mark.parametrize("name", [*SHAPES, "waypoints"])
def test_rates_are_the_derivatives(name: str) -> None:
    """Differences of order eight of q give qd, and of qd qdd, within each smooth part; jumps there are none.

    With h = 2 ms their error is that at the spline's knots, where its fifth derivative jumps by some 100 rad/s^5: h^3
    times that in the slope of qd, h^4 times it in that of q.
    """
    path = SHAPES[name][0] if name in SHAPES else ToolWaypoints(points=WAY, speed=0.3, start=START)
    h = 0.002
    t = np.arange(0.0, 5.0, h)
    q, qd, qdd = motion_of(path, PUMA, t)
    from_samples(t, q, qd, qdd)
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    corners = (
        [1.0, 2.0] if name in SHAPES else [1.0 + x for x in ToolWaypoints(points=WAY, speed=0.3, start=START)._times]
    )
    smooth = np.min(np.abs(t[4:-4, None] - corners), axis=1) > 5 * h
    for value, rate, allowed in ((q, qd, 1e-9), (qd, qdd, 1e-6)):
        slope = sum(w * value[k : len(t) - 8 + k] for k, w in enumerate(weights)) / h
        assert np.max(np.abs(slope - rate[4:-4])[smooth]) < allowed
    for corner in corners:
        before, after = (motion_of(path, PUMA, np.array([corner + x])) for x in (-1e-9, 1e-9))
        assert all(np.max(np.abs(a - b)) < 1e-5 for a, b in zip(before, after, strict=True))


def test_it_starts_at_zero_and_goes_to_the_start_with_least_jerk() -> None:
    """Until `approach` the motion is the quintic's, in every byte."""
    path = SHAPES["circle"][0]
    t = np.arange(1001) * 1e-3
    for got, wanted in zip(motion_of(path, PUMA, t), Quintic(START, 1.0).sample(t, 6), strict=True):
        assert got.tobytes() == wanted.tobytes()


def test_sampling_a_stretch_gives_the_bytes_of_the_whole() -> None:
    """A path is a function of time alone, and each round repeats the one before."""
    path, t = SHAPES["lemniscate"][0], np.arange(8000) * 1e-3
    whole, part = motion_of(path, PUMA, t), motion_of(path, PUMA, t[2345:2400])
    for a, b in zip(whole, part, strict=True):
        assert a[2345:2400].tobytes() == b.tobytes()
        # the round-off of rounds 3 and 4 in u, 1e-15, times slopes of up to 30 rad in one round
        assert a[4000:6000] == pytest.approx(a[6000:8000], abs=1e-11)


@pytest.mark.parametrize("elbow", [1.0, -1.0])
def test_two_links_have_the_closed_form(elbow: float) -> None:
    """On the planar arm of 1 m and 0.8 m: cos q2 from the cosine rule, its sign from the start, q1 from there."""
    arm, start = load_model("two-link"), np.array([0.4, elbow * 1.1])
    path = ToolCircle(radius=0.2, plane="xz", period=1.0, start=tuple(start.tolist()), orientation="free")
    t = np.linspace(1.0, 3.0, 400)
    q = motion_of(path, arm, t).q
    u = 2 * math.pi * rounds(t - 1.0, 1.0)
    x = math.cos(0.4) + 0.8 * math.cos(start.sum()) + 0.2 * (np.cos(u) - 1)
    y = math.sin(0.4) + 0.8 * math.sin(start.sum()) - 0.2 * np.sin(u)  # the arm turns from x towards -z
    q2 = elbow * np.arccos((x**2 + y**2 - 1.0 - 0.64) / 1.6)
    q1 = np.arctan2(y, x) - np.arctan2(0.8 * np.sin(q2), 1.0 + 0.8 * np.cos(q2))
    # the tool errs by 1e-9 m, and by sin q2 > 0.5 the joints by no more than 5 times as much
    assert q == pytest.approx(np.stack([q1, q2], axis=1), abs=5e-9)


@pytest.mark.parametrize(
    ("n", "slide", "orientation"), [(7, None, "kept"), (7, 2, "kept"), (6, 1, "free"), (4, None, "free")]
)
def test_spare_joints_stay_as_near_to_the_start_as_the_pose_allows(n: int, slide: int | None, orientation: str) -> None:
    """The way from the start has no part that moves the joints and leaves the pose, on arms in no special position.

    The Jacobian is one of central differences of the forward kinematics: 1e-9 of error at h = 1e-5.
    """
    arm, start = random_arm(n, slide), np.linspace(0.3, -0.4, n)
    path = ToolCircle(radius=0.03, period=1.0, start=tuple(start.tolist()), orientation=orientation, plane="xz")
    q, h = motion_of(path, arm, np.array([1.7, 2.0])).q, 1e-5
    assert np.max(np.abs(q - start)) > 0.01
    for row in q:
        shifted = arm.forward_kinematics(row + h * np.vstack([np.eye(n), -np.eye(n)]))
        slope = (shifted[:n, :3] - shifted[n:, :3]) / (2 * h)
        J = slope[:, :, 3].T if orientation == "free" else slope.reshape(n, 12).T
        spare = (row - start) - np.linalg.pinv(J, rcond=1e-6) @ J @ (row - start)
        assert np.max(np.abs(spare)) < 1e-7


def test_the_jacobian_is_that_of_the_forward_kinematics() -> None:
    """Poses are those of the model's own method to round-off; columns are central differences to h^2."""
    h = 1e-5
    for arm in (PUMA, random_arm(5, 3)):
        q = np.random.default_rng(0).uniform(-2, 2, (20, arm.n))
        frames, pose = tool_frames(arm, q), arm.forward_kinematics(q)
        assert frames.place == pytest.approx(pose[:, :3, 3], abs=1e-14)
        assert frames.turn == pytest.approx(pose[:, :3, :3], abs=1e-14)
        for j in range(arm.n):
            ahead, behind = (arm.forward_kinematics(q + x * np.eye(arm.n)[j]) for x in (h, -h))
            slope = (ahead - behind)[:, :3] / (2 * h)
            spin = slope[:, :, :3] @ pose[:, :3, :3].transpose(0, 2, 1)
            assert frames.linear[:, :, j] == pytest.approx(slope[:, :, 3], abs=1e-9)
            assert frames.angular[:, :, j] == pytest.approx(spin[:, [2, 0, 1], [1, 2, 0]], abs=1e-9)


def test_a_place_may_be_given() -> None:
    """With `at` the path begins there, with the orientation that the tool has at `start`."""
    at = (0.6, 0.2, 0.1)
    path = ToolCircle(radius=0.05, period=1.0, start=START, at=at)
    pose = PUMA.forward_kinematics(motion_of(path, PUMA, np.array([1.0])).q[0])
    assert pose[:3, 3] == pytest.approx(at, abs=1e-11)
    assert pose[:3, :3] == pytest.approx(PUMA.forward_kinematics(START)[:3, :3], abs=1e-11)


def test_out_of_reach_is_told_with_time_place_and_distance() -> None:
    """A line of the planar arm straight outward from 1.5 m to 2 m leaves its reach of 1.8 m at 0.6 of its length."""
    arm = load_model("two-link")
    fold = math.acos((1.5**2 - 1.64) / 1.6)
    aim = -math.atan2(0.8 * math.sin(fold), 1.0 + 0.8 * math.cos(fold))
    path = ToolLine(to=(0.5, 0.0, 0.0), period=2.0, start=(aim, fold), orientation="free")
    with pytest.raises(PathError) as caught:
        path.on_arm(arm)
    u = math.asin(math.sqrt(0.6)) / math.pi
    assert caught.value.where == pytest.approx(u, abs=2 / 1024)
    text = str(caught.value)
    t = float(text.partition("t = ")[2].partition(" s")[0])
    assert rounds(np.array([t - 1.0]), 2.0)[0] == pytest.approx(u, abs=3 / 1024)
    x, _, z = (float(number) for number in text.partition("[")[2].partition("]")[0].split(","))
    assert (x, z) == pytest.approx((1.8, 0.0), abs=0.005)
    away = float(text.partition("by up to ")[2].partition(" m")[0])
    # the farthest of 16 points of the rest of the line, which is gone there and back
    assert 0.18 < away <= 0.2


REFUSED = {
    "kind: tool-circle, radius: 0.1, period: 2, start: 0": "t = 1 s, tool at .* singular there: the least",
    "kind: tool-circle, radius: 0.5, period: 2, start: [0, -1, 3.3, 0, 0.84, 0]": "come back: waist ends 6.28 rad",
    "kind: tool-circle, radius: 0.1, period: 2, start: [0, -1, 3.3, 0, 0.84, 0], at: [2, 0, 0]": "out of reach",
    "kind: tool-circle, radius: 0.1, period: 2, start: [0, 1]": "got 2 numbers, wanted one number or 6",
    "kind: tool-circle, radius: 0.1, period: 2": "reference.start: missing",
    "kind: tool-line, to: [1, 2], period: 2, start: 0.1": "three numbers, x, y and z",
    "kind: tool-waypoints, points: [], speed: 1, start: 0.1": r"a list of points \[x, y, z\]",
    "kind: tool-waypoints, points: [[1, 2]], speed: 1, start: 0.1": r"points\[0\]",
    "kind: tool-lemniscate, width: 0.1, period: 2, start: 0.1, plane: zx": "plane",
    "kind: tool-circle, radius: 0.1, to: [1, 2, 3], period: 2, start: 0.1": "it belongs to kind: tool-line",
}
CIRCLE = "kind: tool-circle, radius: 10 cm, period: 1.5 s, plane: yz, start: [0, -1, 3.3, 0, 0.84, 0]"
REFUSED |= {
    CIRCLE.replace("3.3", "1e155"): "a joint would be at 1e\\+155",
    CIRCLE.replace("10 cm", "1e300"): "out of reach: it is .* away, the arm .* long",
    CIRCLE + ", at: [1e308, 0, 0]": "out of reach: it is 1e\\+308 m",
}
CONFIG = """
name: path
plant: {engine: analytic, model: puma560}
controllers: [{law: computed-torque, gains: {lam: 20, kv: 20, ki: 0}}]
reference: {REFERENCE}
run: {duration: 2.0, control_period: 0.004}
"""


@pytest.mark.parametrize("reference", REFUSED)
def test_a_config_with_an_impossible_path_is_refused(reference: str) -> None:
    """Each mistake is told when the config is read, with its key."""
    with pytest.raises(ConfigError, match=REFUSED[reference]):
        parse_experiment(CONFIG.replace("REFERENCE", reference))


def test_a_config_s_path_is_dumped_and_read_back() -> None:
    """Every key comes back, lengths with units as numbers in m, points as tuples."""
    for reference in (
        CIRCLE,
        "kind: tool-waypoints, points: [[0, 10 cm, 0]], speed: 20 cm/s, start: 0.3".replace("20 cm/s", "0.2"),
    ):
        experiment = parse_experiment(
            CONFIG.replace("REFERENCE", reference).replace("start: 0.3", f"start: {list(START)}")
        )
        again = parse_experiment(dump_experiment(experiment))
        assert again.reference == experiment.reference
    assert again.reference.points == ((0.0, 0.1, 0.0),)
    for text in TOOL:
        experiment = parse_experiment(text)
        assert parse_experiment(dump_experiment(experiment)) == experiment


def test_errors_of_the_tool_are_those_of_a_rigid_turn() -> None:
    """With the waist off by d, the tool is 2 rho sin(d/2) away and turned by d, rho its distance from the axis.

    A run of another kind of reference has none of these metrics.
    """
    result = run_experiment(parse_experiment(CONFIG.replace("REFERENCE", CIRCLE)))
    ((name, metrics),) = result.metrics.items()
    run = result.runs[name]
    off = 0.01 * np.sin(np.arange(len(run.t)))
    turned = dataclasses.replace(run, q=run.q_ref + off[:, None] * np.eye(6)[0])
    record = record_of(turned, tau_max=np.ones(6), metrics_from=1.0, control_period=0.004, step_like=False, arm=PUMA)
    found = from_joints(measured(record))
    rho = np.linalg.norm(PUMA.forward_kinematics(run.q_ref)[250:, :2, 3], axis=1)
    off = np.abs(off[250:])
    # the angle's d^2 is a difference of numbers near 1: some 1e-14 in 1e-4 d
    assert found.tool_rmse.value == pytest.approx(np.sqrt(np.mean((2 * rho * np.sin(off / 2)) ** 2)), rel=1e-10)
    assert found.tool_max_error.value == pytest.approx(np.max(2 * rho * np.sin(off / 2)), rel=1e-10)
    assert found.tool_turn_rmse.value == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-9)
    assert found.tool_max_turn.value == pytest.approx(np.max(off), rel=1e-9)
    assert found.tool_rmse.per_joint == ()
    assert {"tool_rmse", "tool_max_turn"} < set(metrics.to_json())
    # the loop's own: no joint's error in e takes the tool farther than the arm is long
    assert 0.0 < metrics["tool_max_error"].value < 1.5 * 6 * metrics["max_error"].value
    other = run_experiment(parse_experiment(CONFIG.replace("REFERENCE", "kind: sine, amplitude: 0.1, frequency_hz: 1")))
    assert not any(key.startswith("tool") for key in next(iter(other.metrics.values())).to_json())


def test_a_run_of_a_path_is_stored_and_read_back(tmp_path: Path) -> None:
    """The four metrics of the tool are in metrics.json and read back from there; the page has their columns."""
    from torquebench.results import load_result, run_experiment

    result = run_experiment(parse_experiment(CONFIG.replace("REFERENCE", CIRCLE)), folder=tmp_path / "out")
    again = load_result(tmp_path / "out")
    assert again.metrics.equals(result.metrics)
    assert np.isfinite(again.metrics.loc["computed-torque", "tool_rmse"])
    assert again.metrics.attrs["units"]["tool_turn_rmse"] == "rad"
    assert "tool_rmse" not in again.joint_metrics.index.get_level_values("metric")
    page = (tmp_path / "out" / "report.html").read_text()
    assert "tool [mm]" in page
    assert '"path_from": 1.0' in page or '"path_from":1.0' in page


def test_a_film_shows_the_wanted_path_and_then_the_travelled_one(tmp_path: Path) -> None:
    """Most points of the path, where the scene's camera must show them, are blue when it begins and orange at its end.

    Arm and tool hide some; lines are 2 to 5 px wide.
    """
    from torquebench.results import run_experiment
    from torquebench.video.film import read_footage
    from torquebench.video.job import Job
    from torquebench.video.opengl import STICK
    from torquebench.video.overlay import layout_for
    from torquebench.video.render import FilmRenderer
    from torquebench.video.stage import STICK_TRAIL, STICK_WANTED

    text = CONFIG.replace("REFERENCE", CIRCLE).replace("duration: 2.0", "duration: 2.9")
    result = run_experiment(parse_experiment(text), folder=tmp_path / "out")
    footage, settings = read_footage(tmp_path / "out"), Video()
    assert footage.path_from == 1.0
    renderer = FilmRenderer(Job(footage, settings, STICK))
    box = layout_for(footage.shots, settings.size, 6).panels[0].view
    places = PUMA.forward_kinematics(result.trajectories["computed-torque"].q_ref[260:700:10])[:, :3, 3]
    spots = [pixel(place, camera_of_scene(renderer.camera), renderer.part, box.width, box.height) for place in places]
    for frame, colour in ((25, STICK_WANTED), (71, STICK_TRAIL)):
        picture = np.asarray(renderer.draw(frame), dtype=float)
        view = picture[box.y : box.y + box.height, box.x : box.x + box.width]
        wanted = np.array(ImageColor.getrgb(colour))
        hits = [
            np.min(np.abs(view[int(y) - 2 : int(y) + 3, int(x) - 2 : int(x) + 3] - wanted).sum(axis=2)) < 90
            for x, y in spots
        ]
        assert np.mean(hits) > 0.6
