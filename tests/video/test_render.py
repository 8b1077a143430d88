"""Films show the stored run: every frame of it, the stored pose in each, on every back end there is."""

import json
import shutil

import matplotlib.image
import numpy as np
import pytest

from tests.video.films import camera_of_scene, frames_of, pixel, tool_mark
from torquebench import load_trajectory
from torquebench.cli.app import main
from torquebench.experiment.schema import Video
from torquebench.experiment.store import check_run, write_manifest
from torquebench.robot.puma560.puma import Puma560
from torquebench.video.film import read_footage
from torquebench.video.job import Job
from torquebench.video.opengl import STICK
from torquebench.video.overlay import layout_for
from torquebench.video.render import FilmRenderer

SIZE = (640, 480)
NEAR = 3.0
"""How far the tool's mark may be from where its camera must show it [px]."""


@pytest.fixture
def copy(stored, tmp_path):
    """A copy of the stored run, for a film of its own."""
    return shutil.copytree(stored, tmp_path / "run")


def film(folder, monkeypatch, gl, *options):
    """Make the film of a run with MUJOCO_GL set; return what the manifest says of it."""
    monkeypatch.setenv("MUJOCO_GL", gl)
    assert main(["video", str(folder), *options]) == 0
    return check_run(folder)["video"]


def drawn(folder, *controllers, **settings):
    """Panels of a film of a run, and the part of the camera's picture that it shows."""
    footage = read_footage(folder, controllers)
    return layout_for(footage.shots, SIZE, 6).panels, FilmRenderer(Job(footage, Video(**settings), STICK)).part


def away(picture, panel, part, q, camera):
    """Distance of the tool's mark in a panel's view from where the analytic arm has the tool at `q` [px]."""
    box = panel.view
    view = picture[box.y : box.y + box.height, box.x : box.x + box.width]
    point = Puma560("exact", "fitted").forward_kinematics(q)[:3, 3]
    mark = tool_mark(view)
    assert mark is not None, "the tool is not marked"
    return np.linalg.norm(mark - pixel(point, camera_of_scene(camera), part, box.width, box.height))


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("gl", "backend"), [("egl", "egl"), pytest.param("osmesa", "osmesa", marks=SLOW), ("off", "stick")]
)
def test_every_frame_shows_the_stored_pose(copy, monkeypatch, must_draw, figure, gl, backend):
    """1.2 s at 25 frames a second are 30 frames and 1.20 s exactly; first, middle and last have the tool within 3 px.

    Where it must be comes from the analytic arm's kinematics and the camera's numbers in scene.xml, for each
    controller in its own panel. The manifest names the back end, so that one cannot pass for another.
    """
    if backend != "stick":
        must_draw(backend)
    facts = film(copy, monkeypatch, gl)
    assert facts["backend"] == backend
    assert gl in facts["reason"]
    frames, seconds = frames_of(copy / "video.mp4", *SIZE)
    assert (len(frames), facts["frames"]) == (30, 30)
    assert seconds == pytest.approx(1.2, abs=1e-9)
    assert facts["seconds"] == pytest.approx(1.2)
    worst = 0.0
    panels, part = drawn(copy)
    for name, panel in zip(facts["controllers"], panels, strict=True):
        run = load_trajectory(copy / name / "trajectory.npz")
        for i in (0, 15, 29):
            worst = max(worst, away(frames[i], panel, part, run.q[40 * i], "overview"))
    figure(f"film by {backend}: tool's pixel from its projection [px]", worst, "< 3")
    assert worst < NEAR


@pytest.mark.parametrize(
    ("camera", "gl"),
    [
        ("side", "egl"),
        ("overview", "osmesa"),
        ("side", "off"),
        pytest.param("overview", "egl", marks=SLOW),
        pytest.param("side", "osmesa", marks=SLOW),
        pytest.param("overview", "off", marks=SLOW),
    ],
)
def test_pictures_of_both_cameras(stored, tmp_path, monkeypatch, must_draw, gl, camera):
    """One picture of 0.8 s as PNG, of one controller: its tool is within 3 px, and the ghost can be seen."""
    if gl != "off":
        must_draw(gl)
    monkeypatch.setenv("MUJOCO_GL", gl)
    out = tmp_path / "still.png"
    options = ["--still", "0.8", "--camera", camera, "--controllers", "linear-band", "--out", str(out)]
    assert main(["video", str(stored), *options]) == 0
    picture = np.round(255 * matplotlib.image.imread(out)).astype(np.uint8)
    run = load_trajectory(stored / "linear-band" / "trajectory.npz")
    (panel,), part = drawn(stored, "linear-band", camera=camera)
    assert away(picture, panel, part, run.q[800], camera) < NEAR
    box = panel.view
    r, b = (picture[box.y : box.y + box.height, box.x : box.x + box.width, i].astype(int) for i in (0, 2))
    assert np.count_nonzero(b - r > 45) > 100  # the ghost's blue edge
    assert "video" not in check_run(stored)


def test_the_ghost_shows_the_reference(stored, tmp_path, monkeypatch, must_draw):
    """With the reference 0.4 rad higher in the shoulder the blue is away from the arm, where its tool would be."""
    must_draw("egl")
    monkeypatch.setenv("MUJOCO_GL", "egl")
    folder = shutil.copytree(stored, tmp_path / "run")
    path = folder / "linear-band" / "trajectory.npz"
    with np.load(path) as stored_arrays:
        arrays = dict(stored_arrays)
    arrays["q_ref"] = arrays["q_ref"] + np.array([0, -0.4, 0, 0, 0, 0])
    np.savez(path, **arrays)
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["files"]["linear-band/trajectory.npz"]
    write_manifest(folder, manifest)
    out = tmp_path / "still.png"
    assert main(["video", str(folder), "--still", "0.4", "--controllers", "linear-band", "--out", str(out)]) == 0
    picture = np.round(255 * matplotlib.image.imread(out)).astype(int)
    (panel,), part = drawn(folder, "linear-band")
    box = panel.view
    view = picture[box.y : box.y + box.height, box.x : box.x + box.width]
    point = Puma560("exact", "fitted").forward_kinematics(arrays["q_ref"][400])[:3, 3]
    x, y = pixel(point, camera_of_scene("overview"), part, box.width, box.height)
    around = view[round(y) - 6 : round(y) + 7, round(x) - 6 : round(x) + 7]
    assert np.count_nonzero(around[:, :, 2] - around[:, :, 0] > 45) > 20


def test_making_a_film_again_gives_the_same_bytes(copy, monkeypatch, must_draw):
    """Twice from the same run, on the same back end; nothing is simulated, and the rest of the run is untouched."""
    must_draw("egl")
    before = {name: value for name, value in check_run(copy)["files"].items() if name != "video.mp4"}
    monkeypatch.setattr("torquebench.sim.session.Session.run", lambda *_, **__: pytest.fail("simulated"))
    contents = []
    for _ in range(2):
        film(copy, monkeypatch, "egl", "--size", "320x240", "--speed", "2")
        contents.append((copy / "video.mp4").read_bytes())
    assert contents[0] == contents[1]
    manifest = check_run(copy)
    assert {name: value for name, value in manifest["files"].items() if name != "video.mp4"} == before
    assert "video.mp4" in manifest["files"]
    assert manifest["video"]["frames"] == 15


def test_pretty_has_shadows_and_the_same_pose(stored, tmp_path, monkeypatch, must_draw):
    """Quality pretty darkens the floor where the arm's shadow falls, and shows the same arm within 3 px."""
    must_draw("egl")
    monkeypatch.setenv("MUJOCO_GL", "egl")
    pictures, ((panel,), part) = {}, drawn(stored, "linear-band")
    for quality in ("fast", "pretty"):
        out = tmp_path / f"{quality}.png"
        options = ["--still", "0.4", "--quality", quality, "--controllers", "linear-band", "--out", str(out)]
        assert main(["video", str(stored), *options]) == 0
        pictures[quality] = np.round(255 * matplotlib.image.imread(out)).astype(np.uint8)
        run = load_trajectory(stored / "linear-band" / "trajectory.npz")
        assert away(pictures[quality], panel, part, run.q[400], "overview") < NEAR
    box = panel.view
    fast, pretty = (p[box.y : box.y + box.height, box.x : box.x + box.width].mean(axis=2) for p in pictures.values())
    assert np.count_nonzero(fast - pretty > 40) > 1000


@pytest.mark.parametrize("gl", ["egl", pytest.param("off", marks=SLOW)])
def test_an_arm_without_a_look_has_a_film(stored_two_link, tmp_path, monkeypatch, must_draw, gl):
    """Two-link: the film is made, and its tool's mark moves as far as the tool does (within a tenth)."""
    if gl != "off":
        must_draw(gl)
    folder = shutil.copytree(stored_two_link, tmp_path / "run")
    film(folder, monkeypatch, gl, "--camera", "side")
    frames, _ = frames_of(folder / "video.mp4", *SIZE)
    q = load_trajectory(folder / "pd" / "trajectory.npz").q

    def tool(q):
        elbow = np.array([np.cos(q[0]), -np.sin(q[0])])
        return elbow + 0.8 * np.array([np.cos(q.sum()), -np.sin(q.sum())])

    box = layout_for(read_footage(folder).shots, SIZE, 2).panels[0].view
    marks = [tool_mark(frames[i][box.y : box.y + box.height]) for i in (0, 10, 19)]
    tools = [tool(q[40 * i]) for i in (0, 10, 19)]
    seen = [np.linalg.norm(marks[i] - marks[0]) for i in (1, 2)]
    gone = [np.linalg.norm(tools[i] - tools[0]) for i in (1, 2)]
    assert seen[0] / seen[1] == pytest.approx(gone[0] / gone[1], rel=0.1)


def test_an_exaggerated_error_is_where_it_says(stored, tmp_path, monkeypatch):
    """The tool is where the analytic arm has it at q_ref - factor e, within 3 px, and a sign says so."""
    monkeypatch.setenv("MUJOCO_GL", "off")
    run = load_trajectory(stored / "linear-band" / "trajectory.npz")
    error = run.q_ref[800] - run.q[800]
    factor = 0.5 / np.abs(error).max()
    pictures = []
    for value in (factor, 1.0):
        out = tmp_path / f"{value:g}.png"
        options = [
            "--still",
            "0.8",
            "--exaggerate",
            repr(float(value)),
            "--controllers",
            "linear-band",
            "--out",
            str(out),
        ]
        assert main(["video", str(stored), *options]) == 0
        pictures.append(np.round(255 * matplotlib.image.imread(out)).astype(int))
    (panel,), part = drawn(stored, "linear-band", exaggerate=factor)
    assert away(pictures[0], panel, part, run.q_ref[800] - factor * error, "overview") < NEAR
    signs = [np.abs(picture - [38, 44, 54]).max(axis=2)[panel.view.y :] < 60 for picture in pictures]
    wide = [sign[:, panel.view.x : panel.view.x + panel.view.width].mean(axis=1).max() for sign in signs]
    assert wide[0] > 0.9 > 0.5 > wide[1]
