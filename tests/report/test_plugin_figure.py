"""A figure of a user's own: one function in a plug-in file, drawn and written like the others."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import QUICK
from tests.metrics.test_plugin_metric import Command
from torquebench.errors import RegistryError
from torquebench.figures import FIGURES, figure, figures_in_order

PLUGIN = '''\
"""A figure of a user."""
from torquebench import figure
from torquebench.report.figures.layout import new_page

@figure("phase", title="Phase plane", order=35)
def draw_phase(x):
    """Draw speed over position of the first joint."""
    page = new_page(1, 3.0, 3.0)
    ax = page.add_subplot()
    for run in x.runs:
        ax.plot(run.data.q[:, 0], run.data.qd[:, 0], **run.look)
    return x.finish(page, lambda run: "")
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, registries: None) -> Path:
    """A folder with an experiment and the plug-in, which is also the current one."""
    monkeypatch.chdir(tmp_path)
    for name, text in {"quick.yaml": QUICK, "mine.py": PLUGIN}.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_a_plugin_figure_is_drawn_like_the_others(folder: Path, command: Command) -> None:
    """A config may ask for it; both formats are written, and the manifest has them."""
    more = ("--plugin", "mine.py", "--set", "figures=[phase, torque]", "--out", "out")
    status, _, err = command("run", "quick.yaml", *more)
    assert status == 0, err
    files = json.loads((folder / "out" / "manifest.json").read_text())["files"]
    drawn = {name for name in files if name.startswith("figures/")}
    assert drawn == {f"figures/{name}.{fmt}" for name in ("phase", "torque") for fmt in ("svg", "png")}


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("return x.nothing", "figure 'phase': AttributeError: 'RunView' object has no attribute 'nothing'"),
        ("raise KeyError(*x.certificates)", "figure 'phase': KeyError: ('conventional', 'linear-band')"),
        ("return 1", "figure 'phase' returned int, wanted a matplotlib Figure"),
    ],
)
def test_a_figure_that_cannot_be_drawn_is_named(folder: Path, command: Command, body: str, message: str) -> None:
    """A figure that raises, or is none, ends the command and says so."""
    (folder / "mine.py").write_text(PLUGIN.replace("page = new_page(1, 3.0, 3.0)", body))
    more = ("--plugin", "mine.py", "--set", "figures=[phase]", "--out", "out")
    status, _, err = command("run", "quick.yaml", *more)
    assert status == 3
    assert message in err
    assert "Traceback" not in err


def test_the_order_of_figures_and_names_that_are_taken() -> None:
    """The built-in figures come in this order; a name that one of them has, or that is no slug, is refused."""
    built_in = ["position", "error", "torque", "sliding", "spectrum", "certificates", "rules"]
    assert [info.name for info in figures_in_order()] == built_in
    for name, message in (("torque", "already registered"), ("Phase plane", "lower-case letters, digits and '-'")):
        with pytest.raises(RegistryError, match=message):
            figure(name, title="t")(lambda x: None)
    assert set(FIGURES.names()) == set(built_in)
