"""The pages as a browser shows them: nothing complained of, nothing fetched, all of it visible, on any screen."""

import shlex

import matplotlib.image
import numpy as np
import pytest

from tests.audit.studies import STUDY
from tests.browser.conftest import TWO_LINK
from tests.video.films import camera_of_scene, pixel, tool_mark
from torquebench.audits import run_audit
from torquebench.cli.app import main
from torquebench.report import render
from torquebench.robot.puma560.puma import Puma560
from torquebench.shipped import from_checkout
from torquebench.sim.trajectory import load_trajectory
from torquebench.view.server import serve

CLIPPED = """[...document.querySelectorAll('body *')].filter((x) => !x.closest('.scroll, pre, svg, details')
    && x.getBoundingClientRect().right > document.documentElement.clientWidth + 0.5).map((x) => x.outerHTML)"""
FOVY = 32.0
"""Of the cameras in scene.xml, from top to bottom [deg]."""
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
    """A run's page and one of two runs side by side, as addresses."""
    files = {"report": "one/report.html", "comparison": "comparison.html"}
    return {name: (reported / file).as_uri() for name, file in files.items()}


SETTLED = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


@pytest.mark.parametrize("name", ["report", "comparison"])
def test_a_report_is_read_in_a_browser(browse, pages, keep, name):
    """No error or warning, no request but for the file, on a phone nothing sideways, dark too.

    Only tables and listings in a box of their own may be wider than a phone, and are scrolled in that box.
    """
    shown = {}
    for kind, options in (
        ("light", {}),
        ("dark", {"dark": True}),
        ("phone", {"width": 390, "height": 844, "scale": 2}),
    ):
        page = browse(**options)
        page.go(pages[name])
        page.value(SETTLED)
        assert complaints(page) == []
        assert [request for request in page.requests if not request.startswith("data:")] == [pages[name]]
        assert page.value("document.documentElement.scrollWidth") == options.get("width", 1200)
        assert page.value(CLIPPED) == []
        shown[kind] = pixels(page.picture(keep(f"{name}-{kind}"), whole=kind == "phone"))
        page.close()
    assert np.median(shown["light"][:, :40]) > 240
    assert np.median(shown["dark"][:, :40]) < 40
    assert shown["phone"].shape[1] == 2 * 390


@pytest.mark.parametrize("escaped", [True, False])
def test_no_text_becomes_markup(browse, tmp_path, monkeypatch, escaped):
    """Hostile texts stay texts, in the page and in its data; if they were not escaped, each would be noticed."""
    web = from_checkout("tests/trust").web
    monkeypatch.setattr(render._environment(), "autoescape", escaped)
    render._environment().cache.clear()
    page = browse(False)
    for payload in web.PAYLOADS if escaped else web.PAYLOADS[::3]:
        (tmp_path / "page.html").write_bytes(
            render.render("base", title=payload, lead=f"{payload} <pwned>", scripts=["page"], data={payload: payload})
        )
        found = web.looked_at(page._browser, tmp_path / "page.html", f"{payload} <pwned>")
        assert (found == "") == escaped, (payload, found)
    page.close()
    render._environment().cache.clear()


def canvas_colours(page, number):
    """How many pixels of a chart's canvas are those of the two controllers' lines, within 40 of each component."""
    return page.value(f"""(() => {{
        const canvas = document.querySelectorAll('.u-wrap canvas')[{number}];
        const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
        return controllers.map(({{ colour }}) => {{
            const own = shade(colour).match(/\\d+/g).map(Number);
            let count = 0;
            for (let i = 0; i < data.length; i += 4)
                if (data[i + 3] > 200 && own.every((x, c) => Math.abs(x - data[i + c]) < 40)) count++;
            return count;
        }});
    }})()""")


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_signals_are_drawn_and_chosen(browse, pages, dark):
    """Error and torque of each controller in its colour; boxes add a signal, take a controller away; + zooms all."""
    page = browse(dark=dark)
    page.go(pages["report"])
    page.value(SETTLED)
    for number in (0, 1):
        assert min(canvas_colours(page, number)) > 100
    page.value("document.querySelectorAll('#shown input')[2].click()")
    captions = "[...document.querySelectorAll('#signals figcaption')].map((x) => x.textContent.split(',')[0])"
    assert page.value(captions) == ["elbow: error", "elbow: torque", "elbow: position"]
    page.value("at('joint').value = 0; at('joint').dispatchEvent(new Event('change'))")
    assert page.value(captions) == ["shoulder: error", "shoulder: torque", "shoulder: position"]
    page.value("document.querySelectorAll('#choice input')[0].click()")
    assert canvas_colours(page, 1)[0] == 0
    page.value("at('closer').click()")
    page.value(SETTLED)
    ranges = page.value("[...charts].map(({ scales: { x } }) => [x.min, x.max])")
    assert len(ranges) == 3
    assert all(high - low == pytest.approx(1.199 / 2, rel=1e-6) for low, high in ranges)
    page.value("at('all').click()")
    page.value(SETTLED)
    assert page.value("[...charts][0].scales.x.max") == pytest.approx(1.199)
    assert complaints(page) == []
    page.close()


def test_the_script_shows_the_stored_samples(browse, reported, pages):
    """Error, torque and position that a chart has are those of trajectory.npz, to 5e-5 of the largest."""
    page = browse()
    page.go(pages["report"])
    run = load_trajectory(reported / "one" / "band" / "trajectory.npz")
    c = "controllers.find(({ name }) => name === 'band')"
    stored = {"error": 1e3 * (run.q_ref - run.q), "torque": run.tau, "position": run.q, "sliding": run.s}
    for key, wanted in stored.items():
        found = np.array(page.value(f"SIGNALS.{key}.of({c}, 1)"))
        assert np.max(np.abs(found - wanted[:, 1])) <= 5e-5 * np.max(np.abs(wanted[:, 1])), key
    page.close()


def test_the_commands_of_a_run_name_its_folder(browse, reported, pages, tmp_path, monkeypatch):
    """Where the page is a file each names the page's folder; the first gives the same numbers again as pasted."""
    monkeypatch.chdir(tmp_path)
    page = browse()
    page.go(pages["report"])
    said = page.value("[...document.querySelectorAll('dl.commands code')].map((x) => x.textContent)")
    page.close()
    commands = [shlex.split(text) for text in said]
    assert [words[1] for words in commands] == ["run", "view", "video", "figures", "why"]
    assert {words[2] for words in commands[1:]} == {str(reported / "one")}
    assert main([*commands[0][1:], "--out", "again"]) == 0
    assert (tmp_path / "again" / "metrics.json").read_bytes() == (reported / "one" / "metrics.json").read_bytes()


def test_a_table_sorts_by_hand_and_by_key(browse, pages):
    """A click on a title sorts by it, Enter turns the order round; numbers go by the stored value."""
    page = browse()
    page.go(pages["report"])
    rows = "[...document.querySelector('table.compare').tBodies[0].rows]"
    cells = f"{rows}.map((row) => Number(row.cells[5].dataset.value))"
    title = "document.querySelectorAll('table.compare thead th')[5]"
    page.value(f"{title}.click()")
    assert page.value(cells) == sorted(page.value(cells))
    page.value(f"{title}.dispatchEvent(new KeyboardEvent('keydown', {{key: 'Enter'}}))")
    assert page.value(cells) == sorted(page.value(cells), reverse=True)
    page.close()


def test_a_page_on_paper_has_its_figures(browse, pages):
    """Before printing error and torque of each joint are drawn, in the light theme's ink; afterwards they are gone."""
    page = browse(dark=True)
    page.go(pages["report"])
    before = page.value("document.querySelectorAll('#print canvas').length")
    page.value("dispatchEvent(new Event('beforeprint'))")
    drawn = page.value("document.querySelectorAll('#print canvas').length")
    assert (before, drawn) == (0, 4)
    assert page.value("ink('ink')") == "#1b1f24"
    page.value("dispatchEvent(new Event('afterprint'))")
    assert page.value("document.querySelectorAll('#print canvas').length") == 0
    assert page.call("Page.printToPDF")["data"]
    assert complaints(page) == []
    page.close()


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


def test_a_script_in_a_run_does_not_run(browse, reported, tmp_path):
    """Text that would end its element stays text; a script put on the page does not run, and the console tells it."""
    script = "<script>document.title = 'changed'</script>"
    config = tmp_path / "config.yaml"
    config.write_text(TWO_LINK.replace("name: two-link-test", f'name: two-link-test\ndescription: "</script>{script}"'))
    assert main(["run", str(config), "--out", str(tmp_path / "run"), "--no-figures", "--quiet"]) == 0
    page = browse()
    page.go((tmp_path / "run" / "report.html").as_uri())
    assert page.value("document.title") == "two-link-test"
    assert script in page.value("document.querySelector('p.lead').textContent")
    assert complaints(page) == []
    text = (tmp_path / "run" / "report.html").read_text()
    (tmp_path / "live.html").write_text(text.replace("</body>", f"{script}</body>"))
    page.go((tmp_path / "live.html").as_uri())
    assert page.value("document.title") == "two-link-test"
    assert "Content Security Policy" in str(page.complaints)
    page.close()


def test_a_sideways_scroll_would_be_seen(browse, pages):
    """The phone's check is not blind: something wide put on the page is found."""
    page = browse(width=390, height=844)
    page.go(pages["report"])
    page.value("document.body.insertAdjacentHTML('beforeend', '<div style=\"width:600px\">wide</div>')")
    assert page.value("document.documentElement.scrollWidth") > 390
    assert len(page.value(CLIPPED)) == 1
    page.close()


@pytest.fixture(scope="module")
def served(replayed):
    """Address at which the run is replayed."""
    with serve((replayed / "report.html").read_bytes()) as address:
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


def at_time(page, seconds):
    """Put the page at a time by its slider, the arm in the middle of the window, and wait until it is drawn."""
    page.value(
        f"(() => {{ const s = at('scrub'); s.value = {seconds}; s.dispatchEvent(new Event('input'));"
        " at('arm').scrollIntoView({block: 'center'}); })()"
    )
    page.wait(f"document.body.dataset.time === '{seconds:.4f}'")
    page.value(SETTLED)


def colours_in(view):
    """How many pixels of a view are the arm's shell, the ghost, the tool's mark and the trail, by their colours."""
    r, g, b = np.moveaxis(view, 2, 0)
    return {
        "shell": int(np.count_nonzero((r > 150) & (r - b > 8) & (r - b < 60))),
        "ghost": int(np.count_nonzero(b - r > 60)),
        "tool": int(np.count_nonzero((r - g > 120) & (b - g > 60))),
        "trail": int(np.count_nonzero((r - b > 90) & (r - g > 50) & (g - b > 20))),
    }


def test_the_arm_is_where_the_camera_must_have_it(browse, served, replayed, keep):
    """The tool's mark is within 3 px of the analytic arm's tool, projected by the numbers of the camera in scene.xml.

    The shell is drawn where the arm is: the point half way along the upper arm, from the same kinematics, is not sky.
    """
    page = browse(width=1400, height=800)
    page.go(f"{served}#show=conventional")
    page.value("at('arm').style.height = '300px'")  # wider than high, as the projection takes it
    at_time(page, 0.3)
    view = part(pixels(page.picture(keep("arm-projected"))), box_of(page, "#arm canvas"))
    height, width = view.shape[:2]
    assert width > height
    arm = Puma560("exact", "fitted")
    q = load_trajectory(replayed / "conventional" / "trajectory.npz").q[300]
    camera = camera_of_scene("overview")
    up = np.tan(np.radians(FOVY / 2.0))
    seen = (-up * width / height, up * width / height, -up, up)
    mark = tool_mark(view)
    assert mark is not None
    assert np.linalg.norm(mark - pixel(arm.forward_kinematics(q)[:3, 3], camera, seen, width, height)) < 3.0
    c1, s1, c2, s2 = np.cos(q[0]), np.sin(q[0]), np.cos(q[1]), np.sin(q[1])
    along, across = 0.2 * c2, 0.14909 + 0.097  # links.yaml: the upper arm stands beside the waist's axis
    middle = [c1 * along - s1 * across, s1 * along + c1 * across, -0.2 * s2]
    column, row = np.round(pixel(middle, camera, seen, width, height)).astype(int)
    assert np.abs(view[row, column] - view[5, -5]).sum() > 30
    page.close()


def test_the_replay_plays_and_draws(browse, served, keep):
    """Asked to, it plays; it draws arm, ghost, tool and trail, obeys keys, slider and mouse, and tells a failure.

    An error shown 10 times as large moves the arm away from its ghost.
    """
    page = browse()
    page.go(f"{served}#play=&speed=0.5")
    page.wait("Number(document.body.dataset.time) > 0.03")
    assert page.value("at('speed').value") == "0.5"
    page.press(" ", 32)
    page.wait("at('play').textContent === 'play'")
    stood = page.value("document.body.dataset.time")
    page.value("new Promise((done) => setTimeout(done, 150))")
    assert page.value("document.body.dataset.time") == stood
    at_time(page, 0.3)
    box = box_of(page, "#arm canvas")
    before = part(pixels(page.picture(keep("arm"))), box)
    found = colours_in(before)
    assert found["shell"] > 2000, found
    assert found["ghost"] > 300, found
    assert found["tool"] > 20, found
    assert found["trail"] > 20, found
    marks = page.value("[...document.querySelectorAll('.now')].map((x) => x.getBoundingClientRect().x)")
    assert len(marks) == 2
    assert marks[0] == pytest.approx(marks[1], abs=1.0)
    page.value("at('exaggerate').value = 10; at('exaggerate').dispatchEvent(new Event('change'))")
    page.value(SETTLED)
    larger = part(pixels(page.picture(keep("arm-exaggerated"))), box)
    assert np.mean(np.abs(larger - before).sum(axis=2) > 60) > 0.01
    page.press("ArrowRight", 39)
    page.wait("Number(document.body.dataset.time) > 0.3")
    page.press("ArrowLeft", 37)
    page.wait("document.body.dataset.time === '0.3000'")
    x, y = box[0] + box[2] / 2, box[1] + box[3] / 2
    page.mouse("mousePressed", x, y, button="left", buttons=1, clickCount=1)
    page.mouse("mouseMoved", x + 90, y - 30, button="left", buttons=1)
    page.mouse("mouseReleased", x + 90, y - 30, button="left", clickCount=1)
    page.value(SETTLED)
    turned = part(pixels(page.picture(keep("arm-turned"))), box)
    assert np.mean(np.abs(turned - larger).sum(axis=2) > 60) > 0.02
    page.value("document.activeElement.blur()")
    page.press("End", 35)
    page.wait("document.body.dataset.time === '1.1990'")
    page.value(SETTLED)
    assert page.value("[...document.querySelectorAll('#arm b')].map((x) => x.textContent.trim())") == [
        "",
        "controller error at 0.8 s",
    ]
    assert complaints(page) == []
    assert all(request.partition("#")[0] == served or request.startswith("data:") for request in page.requests)
    page.close()


def test_without_webgl_everything_but_the_arm_is_there(browse, served):
    """It says why, signals are drawn, and nothing is complained of."""
    page = browse(False)
    page.go(served)
    page.value(SETTLED)
    assert "no WebGL" in page.value("at('arm').textContent")
    assert page.value("document.querySelectorAll('#signals canvas').length") == 2
    assert complaints(page) == []
    page.close()


def test_the_arm_on_a_phone_and_in_the_dark(browse, served, keep):
    """With the dark scheme the sky behind the arm is dark, and the arm is still there."""
    page = browse(width=390, height=844, dark=True)
    page.go(served)
    at_time(page, 0.3)
    view = part(pixels(page.picture(keep("arm-phone-dark"))), box_of(page, "#arm canvas"))
    assert np.median(view) < 60
    assert colours_in(view)["shell"] > 300
    assert complaints(page) == []
    page.close()
