"""The pages as a browser shows them: nothing complained of, nothing fetched, all of it visible, on any screen."""

import shutil

import matplotlib.image
import numpy as np
import pytest

from tests.audit.studies import STUDY
from tests.video.films import camera_of_scene, pixel, tool_mark
from torquebench.audits import run_audit
from torquebench.cli.app import main
from torquebench.experiment.store import add_to_run
from torquebench.robot.puma560.puma import Puma560
from torquebench.sim.trajectory import load_trajectory
from torquebench.video.film import read_footage
from torquebench.view.replay import replay_json
from torquebench.view.server import serve

BOXES = """[...document.querySelectorAll('figure img')].map(
    (image) => [image.getBoundingClientRect(), image.naturalWidth]).map(
    ([box, width]) => [box.width, box.height, width])"""
CLIPPED = """[...document.querySelectorAll('body *')].filter((x) => !x.closest('.scroll, pre, svg, details')
    && x.getBoundingClientRect().right > document.documentElement.clientWidth + 0.5).map((x) => x.outerHTML)"""
SOFTWARE = "GPU stall due to ReadPixels"
"""What a machine without a graphics card says of itself; nothing that a page could do about."""


def pixels(path):
    """A picture, (height, width, 3), 0 to 255."""
    return np.round(255 * matplotlib.image.imread(path)[:, :, :3]).astype(int)


def complaints(page):
    """What the console has, but for what the machine says of itself."""
    return [c for c in page.complaints if not (isinstance(c, dict) and SOFTWARE in c.get("text", ""))]


@pytest.fixture(scope="module")
def pages(reported):
    """A run's page and one of two runs side by side, as addresses, with how many figures each has."""
    return {
        "report": ((reported / "one" / "report.html").as_uri(), 0),
        "comparison": ((reported / "comparison.html").as_uri(), 2),
    }


@pytest.mark.parametrize("name", ["report", "comparison"])
def test_a_report_is_read_in_a_browser(browse, pages, keep, name):
    """No error or warning, no request but for the file, every figure drawn, on a phone nothing sideways, dark too.

    Only tables and listings in a box of their own may be wider than a phone, and are scrolled in that box.
    """
    address, figures = pages[name]
    shown = {}
    for kind, options in (
        ("light", {}),
        ("dark", {"dark": True}),
        ("phone", {"width": 390, "height": 844, "scale": 2}),
    ):
        page = browse(**options)
        page.go(address)
        assert page.complaints == []
        assert [request for request in page.requests if not request.startswith("data:image/svg+xml;")] == [address]
        boxes = page.value(BOXES)
        assert len(boxes) == figures
        assert all(width > 200 and height > 100 and own > 100 for width, height, own in boxes)
        assert page.value("document.documentElement.scrollWidth") == options.get("width", 1200)
        assert page.value(CLIPPED) == []
        shown[kind] = pixels(page.picture(keep(f"{name}-{kind}"), whole=kind == "phone"))
        page.close()
    assert np.median(shown["light"][:, :40]) > 240
    assert np.median(shown["dark"][:, :40]) < 40
    assert shown["phone"].shape[1] == 2 * 390


@pytest.fixture(scope="module")
def audited(tmp_path_factory):
    """The page of a small audit, as an address."""
    folder = tmp_path_factory.mktemp("audit")
    (folder / "study.yaml").write_text(STUDY)
    return (run_audit(folder / "study.yaml", folder=folder / "out").folder / "report.html").as_uri()


ORDER = """[...document.querySelectorAll('table.sortable')[1].tBodies[0].rows].map(
    (row) => parseFloat(row.cells[3].innerText.slice(1)))"""
SHOWN = "[...document.querySelectorAll('tr[data-group]')].filter((x) => getComputedStyle(x).display != 'none').length"


@pytest.mark.parametrize("options", [{}, {"dark": True}, {"width": 390, "height": 844}], ids=["light", "dark", "phone"])
def test_the_claims_of_an_audit_are_read_in_a_browser(browse, audited, keep, options):
    """Nothing complained of or fetched, nothing sideways; a title sorts its column, a level leaves its own cases."""
    page = browse(**options)
    page.go(audited)
    assert page.complaints == []
    assert [request for request in page.requests if not request.startswith("data:image/svg+xml;")] == [audited]
    assert page.value("document.documentElement.scrollWidth") == options.get("width", 1200)
    assert page.value(CLIPPED) == []
    page.value("document.querySelectorAll('details').forEach((x) => x.open = true)")
    title = "document.querySelectorAll('table.sortable')[1].querySelectorAll('th')[3]"
    page.value(f"{title}.click()")
    assert page.value(ORDER) == sorted(page.value(ORDER))
    page.value(f"{title}.dispatchEvent(new KeyboardEvent('keydown', {{key: 'Enter'}}))")
    assert page.value(ORDER) == sorted(page.value(ORDER), reverse=True)
    every = page.value(SHOWN)
    page.value("document.querySelector('#group-2').click()")
    assert 0 < page.value(SHOWN) < every
    page.picture(keep(f"audit-{'-'.join(map(str, options.values())) or 'light'}"))
    page.close()


def test_a_script_in_a_stored_figure_does_not_run(browse, reported, tmp_path):
    """A figure that would change the page's title, and a script on the page itself: neither runs.

    The second is told in the console, by the policy: the check is not blind.
    """
    run = shutil.copytree(reported / "one", tmp_path / "run")
    script = "<script>top.document.title = document.title = 'changed'</script>"
    add_to_run(run, {"figures/error.svg": f"<svg xmlns='http://www.w3.org/2000/svg' width='9'>{script}</svg>".encode()})
    assert main(["report", str(run), "--quiet"]) == 0
    page = browse()
    page.go((run / "report.html").as_uri())
    assert page.value("document.title") == "figures-test"
    assert page.complaints == []
    (tmp_path / "live.html").write_text((run / "report.html").read_text().replace("</body>", f"{script}</body>"))
    page.go((tmp_path / "live.html").as_uri())
    assert page.value("document.title") == "figures-test"
    assert "Content Security Policy" in str(page.complaints)
    page.close()


def test_a_sideways_scroll_would_be_seen(browse, pages):
    """The phone's check is not blind: something wide put on the page is found."""
    page = browse(width=390, height=844)
    page.go(pages["report"][0])
    page.value("document.body.insertAdjacentHTML('beforeend', '<div style=\"width:600px\">wide</div>')")
    assert page.value("document.documentElement.scrollWidth") > 390
    assert len(page.value(CLIPPED)) == 1
    page.close()


@pytest.fixture(scope="module")
def served(replayed):
    """Address at which the run is replayed."""
    footage = read_footage(replayed)
    runs = [load_trajectory(shot.trajectory) for shot in footage.shots]
    with serve(replay_json(footage, runs, ["#0072B2", "#D55E00"], 1.0)) as address:
        yield address


def box_of(page, selector):
    """Left, top, width and height of an element [px]."""
    return page.value(
        f"(({{x, y, width, height}}) => [x, y, width, height])"
        f"(document.querySelector('{selector}').getBoundingClientRect())"
    )


def part(picture, box):
    """The pixels of a box of a picture of scale 1."""
    x, y, width, height = (round(v) for v in box)
    return picture[y : y + height, x : x + width]


def at_frame(page, frame):
    """Put the replay at a frame with the keyboard, and wait until it is drawn."""
    page.press("Home", 36)
    page.press("End", 35)
    page.press(" ", 32) if page.value("document.getElementById('play').textContent") == "pause" else None
    page.value(
        f"(() => {{ const s = document.getElementById('scrub'); s.value = {frame / 100};"
        " s.dispatchEvent(new Event('input')); })()"
    )
    page.wait(f"document.body.dataset.frame === '{frame}'")
    page.value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def colours_in(view):
    """How many pixels of a view are the arm's shell, the ghost, the tool's mark and the trail, by their colours."""
    r, g, b = np.moveaxis(view, 2, 0)
    return {
        "shell": int(np.count_nonzero((r > 150) & (r - b > 8) & (r - b < 60))),
        "ghost": int(np.count_nonzero(b - r > 60)),
        "tool": int(np.count_nonzero((r - g > 120) & (b - g > 60))),
        "trail": int(np.count_nonzero((r - b > 90) & (r - g > 50) & (g - b > 20))),
    }


@pytest.mark.parametrize("webgl", [True, False], ids=["webgl", "without"])
def test_the_replay_shows_the_arm_where_the_camera_must_have_it(browse, served, replayed, keep, webgl):
    """The tool's mark is within 3 px of the analytic arm's tool, projected by the numbers of the camera in scene.xml.

    The shell is drawn where the arm is: the point half way along the upper arm, from the same kinematics, is not sky.
    """
    page = browse(webgl, width=1400, height=800)  # views wider than high, as the projection takes them
    page.go(served)
    page.wait("Number(document.body.dataset.frame) > 3")
    at_frame(page, 30)
    view = part(pixels(page.picture(keep("view-projected"))), box_of(page, "canvas.arm"))
    height, width = view.shape[:2]
    assert width > height
    arm = Puma560("exact", "fitted")
    q = load_trajectory(replayed / "conventional" / "trajectory.npz").q[300]
    camera = camera_of_scene("overview")
    mark = tool_mark(view)
    assert mark is not None
    assert np.linalg.norm(mark - pixel(arm.forward_kinematics(q)[:3, 3], camera, width, height)) < 3.0
    c1, s1, c2, s2 = np.cos(q[0]), np.sin(q[0]), np.cos(q[1]), np.sin(q[1])
    along, across = 0.2 * c2, 0.14909 + 0.097  # links.yaml: the upper arm stands beside the waist's axis
    middle = [c1 * along - s1 * across, s1 * along + c1 * across, -0.2 * s2]
    column, row = np.round(pixel(middle, camera, width, height)).astype(int)
    assert np.abs(view[row, column] - view[5, 5]).sum() > 30
    page.close()


@pytest.mark.parametrize("webgl", [True, False], ids=["webgl", "without"])
def test_the_replay_plays_and_draws(browse, served, keep, webgl):
    """It plays by itself, draws arm, ghost, tool and trail, obeys keys, slider and mouse, and tells a failure."""
    page = browse(webgl)
    page.go(served)
    page.wait("Number(document.body.dataset.frame) > 3")
    assert page.value("document.body.dataset.drawn") == ("WithWebGl" if webgl else "Painter")
    page.press(" ", 32)
    page.wait("document.getElementById('play').textContent === 'play'")
    stood = page.value("document.body.dataset.frame")
    page.value("new Promise((done) => setTimeout(done, 150))")
    assert page.value("document.body.dataset.frame") == stood
    at_frame(page, 30)
    picture = pixels(page.picture(keep(f"view-{'webgl' if webgl else 'painter'}")))
    box = box_of(page, "canvas.arm")
    before = part(picture, box)
    found = colours_in(before)
    assert found["shell"] > 3000, found
    assert found["ghost"] > 1500, found
    assert found["tool"] > 20, found
    assert found["trail"] > 20, found
    bars, trace = (part(picture, box_of(page, f"canvas.{name}")) for name in ("bars", "trace"))
    assert len(np.unique(bars.reshape(-1, 3), axis=0)) > 10
    assert np.count_nonzero(np.abs(trace - np.array([0x00, 0x72, 0xB2])).sum(axis=2) < 60) > 100
    page.press("ArrowRight", 39)
    page.wait("document.body.dataset.frame === '31'")
    page.press("ArrowLeft", 37)
    page.wait("document.body.dataset.frame === '30'")
    x, y = box[0] + box[2] / 2, box[1] + box[3] / 2
    page.mouse("mousePressed", x, y, button="left", buttons=1, clickCount=1)
    page.mouse("mouseMoved", x + 90, y - 30, button="left", buttons=1)
    page.mouse("mouseReleased", x + 90, y - 30, button="left", clickCount=1)
    page.value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    turned = part(pixels(page.picture(keep("view-turned"))), box)
    assert np.mean(np.abs(turned - before).sum(axis=2) > 60) > 0.02
    page.press("End", 35)
    page.wait("document.body.dataset.frame === '119'")
    assert page.value("[...document.querySelectorAll('h2 strong')].map((x) => x.textContent)") == [
        "",
        "controller error at 0.8 s",
    ]
    assert complaints(page) == []
    assert all(request.startswith(served) or request == "data:," for request in page.requests)
    page.close()


def test_the_replay_on_a_phone_and_in_the_dark(browse, served, keep):
    """390 px wide nothing scrolls sideways; with the dark scheme page and sky are dark, and the arm is still there."""
    page = browse(width=390, height=844, dark=True)
    page.go(served)
    page.wait("Number(document.body.dataset.frame) > 3")
    at_frame(page, 30)
    assert page.value("document.documentElement.scrollWidth") == 390
    assert page.value(CLIPPED) == []
    view = part(pixels(page.picture(keep("view-phone-dark"))), box_of(page, "canvas.arm"))
    assert np.median(view) < 60
    assert colours_in(view)["shell"] > 500
    assert complaints(page) == []
    page.close()
