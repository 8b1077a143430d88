"""``torquebench figures``: what is asked for is drawn, in the formats and widths asked for; names are checked."""

from __future__ import annotations

import re

import pytest

from torquebench.cli.app import main
from torquebench.experiment.folder import read_result
from torquebench.experiment.store import check_run
from torquebench.figures import FIGURES
from torquebench.report.figures import files
from torquebench.report.figures.files import Wish
from torquebench.report.run import draw_run

CONFIG = """\
name: quick
plant: {engine: mujoco, model: two-link}
controllers:
  - {name: conventional, law: smc, switching: sign, gains: {lam: 10, k: 0.3}}
  - {name: linear-band, law: linear-band-smc, gains: {lam: 10, k: 0.3, phi: 0.3, kv: 20}}
reference: {kind: sine, amplitude: 0.8, frequency_hz: 1.0}
run: {duration: 0.8, metrics_from: 0.2}
"""


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """Return the folder of a finished run of two joints, which tests copy."""
    folder = tmp_path_factory.mktemp("two")
    (folder / "quick.yaml").write_text(CONFIG)
    assert main(["run", str(folder / "quick.yaml"), "--out", str(folder / "one"), "--quiet"]) == 0
    return folder / "one"


def drawn(folder):
    """Return the figures that the manifest has."""
    return {name for name in check_run(folder)["files"] if name.startswith("figures/")}


def test_a_run_draws_nothing_unless_asked(run, command):
    """No figures beside the numbers; afterwards those that are wanted, in the manifest, and linked on the page."""
    assert drawn(run) == set()
    assert command("figures", run, "--only", "error", "--only", "torque")[0] == 0
    assert drawn(run) == {f"figures/{name}.{fmt}" for name in ("error", "torque") for fmt in ("svg", "png")}
    page = (run / "report.html").read_text()
    assert set(re.findall(r'href="(figures/[^"]*)"', page)) == drawn(run)


def test_for_paper_there_are_two_widths_and_pdf(run, command):
    """85 mm and 180 mm, written in each SVG to 0.1 mm; no text smaller than 7 pt, no headings."""
    assert command("figures", run, "--only", "torque", "--pdf", "--for", "paper")[0] == 0
    names = [f"figures/torque-{width}mm.{fmt}" for width in (85, 180) for fmt in ("svg", "png", "pdf")]
    assert drawn(run) == set(names)
    for width in (85.0, 180.0):
        text = (run / f"figures/torque-{width:g}mm.svg").read_text()
        points = float(re.search(r'<svg[^>]* width="([0-9.]+)pt"', text)[1])
        assert points / 72.0 * 25.4 == pytest.approx(width, abs=0.1)
        sizes = [float(size) / 0.01 for size in re.findall(r"scale\((0\.[0-9]+) -", text)]
        assert sizes
        assert min(sizes) >= 6.99
    assert (run / "figures/torque-85mm.pdf").read_bytes().startswith(b"%PDF-")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("toruqe", "--only: got 'toruqe' (did you mean 'torque'?)"),
        ("rules", "--only: got 'rules', wanted one of: "),
    ],
)
def test_a_figure_that_there_is_not_is_refused(run, command, name, said):
    """Exit status 2 and nothing written, be the name unknown or the run without such a figure."""
    before = (run / "manifest.json").read_bytes()
    status, _, err = command("figures", run, "--only", name, "--only", "error")
    assert status == 2
    assert said in err
    assert (run / "manifest.json").read_bytes() == before
    assert not (run / "figures").exists()


def test_names_in_a_config_are_checked(quick, command):
    """An unknown name is refused at its place before anything runs; the nearest is named."""
    quick.write_text(quick.read_text() + "figures: [torqe]\n")
    status, _, err = command("run", quick, "--out", "two")
    assert status == 2
    assert "figures[0]: got the text 'torqe'" in err
    assert "did you mean 'torque'?" in err
    assert not (quick.parent / "two").exists()


def test_bytes_do_not_depend_on_processes(run, monkeypatch):
    """Drawn here or in two other processes, every file is the same."""
    result = read_result(run)
    names = ("position", "error", "sliding")
    monkeypatch.setattr(files, "LEAST", 3)
    assert set(names) < set(FIGURES)
    assert draw_run(result, names, Wish(workers=2)) == draw_run(result, names, Wish())
