"""What draws is found by trying, in processes that may die or hang; the choice has a reason in words."""

import sys
import textwrap

import pytest

from torquebench.errors import VideoError
from torquebench.video import opengl
from torquebench.video.opengl import (
    Backend,
    advice,
    candidates,
    drawing_backends,
    environment,
    probe,
    probe_window,
    reason,
    run_module,
)


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
    """Say which back ends draw, without trying; returns the list of those tried."""
    tried = []

    def set_to(*names):
        def trial(name):
            tried.append(name)
            return Backend(name, name in names, "" if name in names else f"cannot load lib{name}.so", "soft")

        monkeypatch.setattr(opengl, "probe", trial)
        return tried

    monkeypatch.setattr(sys, "platform", "linux")
    return set_to


def test_the_first_that_draws_is_taken_and_no_more_are_tried(draws):
    """EGL draws: OSMesa is not asked. OSMesa is next where EGL does not, with EGL's reason."""
    tried = draws("egl", "osmesa")
    chosen, failed = next(drawing_backends(None))
    assert (chosen.name, failed, tried) == ("egl", (), ["egl"])
    draws("osmesa")
    chosen, failed = next(drawing_backends(None))
    assert chosen.name == "osmesa"
    assert reason(chosen, failed, None) == "the first that draws (egl: cannot load libegl.so)"
    assert reason(*next(drawing_backends("osmesa")), "osmesa") == "MUJOCO_GL=osmesa"


def test_nothing_draws_gives_the_stick_figure_and_what_to_install(draws):
    """All candidates' reasons are in the reason, and the packages of EGL and OSMesa in the advice."""
    draws()
    chosen, failed = next(drawing_backends("glfw"))
    assert chosen.name == "stick"
    text = reason(chosen, failed, "glfw")
    assert all(f"{name}: cannot load" in text for name in ("glfw", "egl", "osmesa"))
    assert "libegl1 libgl1" in advice(failed)
    assert "libosmesa6" in advice(failed)
    assert advice(failed).count("apt-get") == 2


def test_no_opengl_on_request_is_the_stick_figure_without_advice(draws):
    """MUJOCO_GL=off: nothing is tried, the reason is the wish."""
    tried = draws("egl")
    chosen, failed = next(drawing_backends("off"))
    assert (chosen.name, failed, tried) == ("stick", (), [])
    assert reason(chosen, failed, "off") == "MUJOCO_GL=off asks for no OpenGL"
    assert advice(failed) == ""


@pytest.mark.parametrize("name", ["nonsense", "glfw"])
def test_a_back_end_that_cannot_draw_is_found_out_and_says_why(name, monkeypatch):
    """A name that MuJoCo does not know, and a window without a display, fail in their own process with a reason."""
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    found = probe(name)
    assert not found.ok
    assert found.why
    assert "\n" not in found.why


def test_a_window_without_a_display_is_found_out(monkeypatch):
    """Neither DISPLAY nor WAYLAND_DISPLAY, or one that nothing answers to: no window, a reason, and nothing dies."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert "neither DISPLAY nor WAYLAND_DISPLAY is set" in probe_window()
    monkeypatch.setenv("DISPLAY", ":9437")
    assert "\n" not in probe_window()
    assert probe_window()


def test_a_process_of_its_own_has_its_own_opengl(monkeypatch):
    """MUJOCO_GL is as asked, PyOpenGL's own choice is not passed on, the rest of the environment is."""
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "egl")
    monkeypatch.setenv("SOMETHING", "else")
    found = environment("osmesa")
    assert found["MUJOCO_GL"] == "osmesa"
    assert "PYOPENGL_PLATFORM" not in found
    assert found["SOMETHING"] == "else"


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Make a module whose code is given; returns its name."""

    def make(code):
        (tmp_path / "acting.py").write_text(textwrap.dedent(code))
        monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
        return "acting"

    return make


def test_a_process_answers_with_its_last_object(module):
    """Objects are heard one by one; lines that are none, as libraries write them, are passed over."""
    heard = []
    name = module("""
        import sys, os, json
        print("some library says hello")
        print(json.dumps({"frame": 1}))
        print(json.dumps({"made": sys.stdin.read() + os.environ["MUJOCO_GL"]}))
    """)
    assert run_module(name, "given", "egl", 60.0, heard.append) == {"made": "givenegl"}
    assert heard[-2:] == [{"frame": 1}, {"made": "givenegl"}]


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import os; os.abort()", "status -6"),
        ("raise SystemExit('no display')", "status 1: no display"),
        ("import sys; sys.exit(0)", "it said nothing"),
        ("print('{}')", "it said nothing"),
    ],
)
def test_a_process_that_dies_is_an_error_with_its_words(module, code, said):
    """A crash, an exit and silence are told apart; none ends this process."""
    with pytest.raises(VideoError, match=said):
        run_module(module(code), "x" * 1_000_000, "egl", 60.0)


def test_a_process_that_hangs_is_ended(module):
    """After a silence of the length given it is killed, even when it has told something before."""
    with pytest.raises(VideoError, match=r"silent for 0\.5 s"):
        run_module(module("import time; print('{\"frame\": 1}', flush=True); time.sleep(600)"), "", "egl", 0.5)
