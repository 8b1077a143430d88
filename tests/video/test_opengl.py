"""What draws is found by trying, in processes that may die or hang; the choice has a reason in words."""

import os
import sys
import textwrap

import pytest

from torquebench.errors import VideoError
from torquebench.experiment.schema import Video
from torquebench.video import film
from torquebench.video.film import make_film
from torquebench.video.job import Footage
from torquebench.video.opengl import Backend, candidates, probe
from torquebench.video.process import CrashedError, answers


@pytest.mark.parametrize(
    ("wish", "order"),
    [
        (None, ("egl", "osmesa")),
        ("", ("egl", "osmesa")),
        ("osmesa", ("osmesa", "egl")),
        ("EGL ", ("egl", "osmesa")),
        ("glfw", ("glfw", "egl", "osmesa")),
        ("off", ()),
        ("disable", ()),
    ],
)
def test_the_users_choice_comes_first_then_egl_then_osmesa(monkeypatch, wish, order):
    """MUJOCO_GL first, whatever its case; each once; none when it asks for none."""
    monkeypatch.setattr(sys, "platform", "linux")
    assert candidates(wish) == order


@pytest.fixture
def draws(monkeypatch):
    """Say which back ends draw and which crash in drawing, without trying; returns the list of those tried."""
    tried = []

    def set_to(*names, crashing=()):
        def trial(name):
            tried.append(name)
            return Backend(name, "" if name in names else f"cannot load lib{name}.so", "soft")

        def drawn(_, job, gl, silence):
            assert gl == (job.backend if job.backend != "stick" else "off")
            if job.backend in crashing:
                raise CrashedError("ended with status -11: it said nothing")
            with open(job.out, "wb") as file:
                file.write(b"film")
            yield 1, 1, {}
            yield 0, 1, {"backend": job.backend}

        monkeypatch.setattr(film, "probe", trial)
        monkeypatch.setattr(film, "answers", drawn)
        tried.clear()
        return tried

    monkeypatch.setattr(sys, "platform", "linux")
    return set_to


def made(gl):
    """A film by whatever draws."""
    return make_film(Footage("title", "puma560", 0.001, 1.0, ()), Video(), gl)


def test_the_first_that_draws_is_taken_and_no_more_are_tried(draws):
    """EGL draws: OSMesa is not asked. OSMesa is next where EGL does not, with EGL's reason."""
    tried = draws("egl", "osmesa")
    facts = made(None).facts
    assert (facts["backend"], facts["reason"], tried) == ("egl", "the first that draws", ["egl"])
    draws("osmesa")
    facts = made(None).facts
    assert (facts["backend"], facts["renderer"]) == ("osmesa", "soft")
    assert facts["reason"] == "the first that draws (egl: cannot load libegl.so)"
    assert made("osmesa").facts["reason"] == "MUJOCO_GL=osmesa"


def test_one_that_crashes_in_drawing_is_followed_by_the_next(draws):
    """EGL passes its trial and then dies: OSMesa draws, and EGL's end is in the reason."""
    draws("egl", "osmesa", crashing=["egl"])
    facts = made(None).facts
    assert facts["backend"] == "osmesa"
    assert facts["reason"] == "the first that draws (egl: drawing ended with status -11: it said nothing)"
    draws(crashing=["stick"])
    with pytest.raises(VideoError, match="drawing the film ended with status -11"):
        made(None)


def test_nothing_draws_gives_the_stick_figure_and_what_to_install(draws):
    """All candidates' reasons are in the reason, and the packages of EGL and OSMesa in the advice."""
    draws()
    found = made("glfw")
    assert found.facts["backend"] == "stick"
    assert all(f"{name}: cannot load" in found.facts["reason"] for name in ("glfw", "egl", "osmesa"))
    assert "libegl1 libgl1" in found.advice
    assert "libosmesa6" in found.advice
    assert found.advice.count("apt-get") == 2


def test_no_opengl_on_request_is_the_stick_figure_without_advice(draws):
    """MUJOCO_GL=off: nothing is tried, the reason is the wish."""
    tried = draws("egl")
    found = made("off")
    assert (found.facts["backend"], found.facts["reason"]) == ("stick", "MUJOCO_GL=off asks for no OpenGL")
    assert (found.advice, tried) == ("", [])


@pytest.mark.parametrize("name", ["nonsense", "glfw"])
def test_a_back_end_that_cannot_draw_is_found_out_and_says_why(name, monkeypatch):
    """A name that MuJoCo does not know, and a window without a display, fail in their own process with a reason."""
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    found = probe(name)
    assert not found.ok
    assert found.why
    assert "\n" not in found.why


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Make a module whose function ``main`` has the code that is given; returns its name."""

    def make(code):
        body = textwrap.indent(textwrap.dedent(code), "    ")
        (tmp_path / "acting.py").write_text(f"def main(job):\n    import os, sys, time\n{body}\n    yield\n")
        monkeypatch.syspath_prepend(tmp_path)
        return "acting"

    return make


def test_a_process_of_its_own_has_its_own_opengl(module, monkeypatch):
    """MUJOCO_GL is as asked, PyOpenGL's own choice is not passed on, the rest is; here all stays as it was."""
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "egl")
    monkeypatch.setenv("SOMETHING", "else")
    name = module("yield [os.environ.get(x) for x in ('MUJOCO_GL', 'PYOPENGL_PLATFORM', 'SOMETHING')]")
    assert list(answers(name, None, "osmesa", 60.0)) == [["osmesa", None, "else"]]
    assert os.environ["MUJOCO_GL"] == os.environ["PYOPENGL_PLATFORM"] == "egl"


def test_a_process_answers_one_by_one(module, capfd):
    """Answers come as they are made; what libraries write to standard output and error is seen nowhere."""
    name = module("""
        print("some library says hello", flush=True)
        os.system("echo another one >&2")
        yield {"frame": 1}
        yield job + os.environ["MUJOCO_GL"]
    """)
    assert list(answers(name, "given" * 100_000, "egl", 60.0)) == [{"frame": 1}, "given" * 100_000 + "egl"]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("os.abort()", "status -6"),
        ("raise SystemExit('no display')", "status 1: no display"),
        ("sys.exit(0)", "it said nothing"),
        ("yield 1; os._exit(0)", "it said nothing"),
        ("raise ValueError('no such thing')", "status 1: .*ValueError: no such thing"),
    ],
)
def test_a_process_that_dies_is_an_error_with_its_words(module, code, said):
    """A crash, an exit and silence are told apart; none ends this process."""
    with pytest.raises(CrashedError, match=said):
        list(answers(module(code), "x" * 1_000_000, "egl", 60.0))


def test_an_error_of_the_package_is_passed_on(module):
    """Its text is that of the error here, and it is no crash."""
    code = "from torquebench.errors import ModelError\nraise ModelError('no arm')"
    with pytest.raises(VideoError, match=r"^no arm$") as caught:
        list(answers(module(code), None, "egl", 60.0))
    assert not isinstance(caught.value, CrashedError)


def test_a_process_that_hangs_is_ended(module):
    """After a silence of the length given it is killed, even when it has told something before."""
    with pytest.raises(CrashedError, match=r"silent for 2 s"):
        list(answers(module("yield 1\ntime.sleep(600)"), None, "egl", 2.0))
