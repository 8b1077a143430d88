"""The page of a sweep in a browser: what counts filters table and front, titles sort, a row gives its commands."""

import json
import shlex

import numpy as np
import pytest

from tests.report.test_sweep_page import GRID, LAM, MASS, SUMMARY, TABLE, page_of, run
from tests.sweep.examples import SMALL
from tests.sweep.tables import made
from torquebench.cli.app import main
from torquebench.sweep.best import best_choices

COLUMN = """[...document.querySelectorAll('#best tbody tr')].map((row) => parseFloat(row.cells[%d].textContent))"""
WIDE = """[...document.querySelectorAll('body *')].filter((x) => !x.closest('.scroll, pre, svg, details')
    && x.getBoundingClientRect().right > document.documentElement.clientWidth + 0.5).map((x) => x.outerHTML)"""
TITLE = "document.querySelectorAll('#best thead th[tabindex]')[%d]"
ERROR, CHATTERING = 3, 4
"""Columns behind the law and two keys."""


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """The page of a sweep of two laws, one of which fails once."""
    path = tmp_path_factory.mktemp("sweep") / "report.html"
    path.write_bytes(page_of(TABLE))
    return path.as_uri()


@pytest.mark.parametrize("options", [{}, {"dark": True}, {"width": 390, "height": 844}], ids=["light", "dark", "phone"])
def test_a_sweep_is_read_in_a_browser(browse, address, keep, options):
    """Nothing complained of or fetched, nothing sideways but in boxes of their own."""
    page = browse(**options)
    page.go(address)
    assert page.requests == [address]
    assert page.value("document.documentElement.scrollWidth") == options.get("width", 1200)
    assert page.value(WIDE) == []
    page.picture(keep(f"sweep-{'-'.join(map(str, options.values())) or 'light'}"), whole=True)
    assert page.complaints == []
    page.close()


def test_the_table_is_what_the_summary_says(browse, address):
    """The best choices, each in its worst load, in order, one with a failed run last; sorted anew by Enter."""
    page = browse()
    page.go(address)
    for place, column, metric in ((0, ERROR, "rmse"), (1, CHATTERING, "chattering")):
        choices = best_choices(SUMMARY, metric)
        scale = 1e3 if metric == "rmse" else 1.0
        wanted = [float(f"{scale * one.figures[metric].mean:.4g}") for one in choices]
        if place:
            page.value(f"{TITLE % place}.dispatchEvent(new KeyboardEvent('keydown', {{key: 'Enter'}}))")
        assert page.value(COLUMN % column) == wanted
        assert choices[-1].completed < choices[-1].runs
    page.value(f"{TITLE % 1}.click()")
    assert page.value(COLUMN % CHATTERING) == [*sorted(wanted[:-1], reverse=True), wanted[-1]]
    bold = page.value("[...document.querySelectorAll('#best tbody tr td.best')].map((x) => parseFloat(x.textContent))")
    assert min(float(f"{1e3 * one.figures['rmse'].mean:.4g}") for one in best_choices(SUMMARY)[:-1]) in bold
    assert page.complaints == []
    page.close()


def test_what_counts_filters_table_and_front(browse, address):
    """At most 5 % of chattering leaves law b; a key's own value, or each of them, in place of the worst."""
    page = browse()
    page.go(address)
    assert page.value("document.querySelectorAll('#front circle.off').length") == 1  # had a failed run
    box = "document.querySelector('#controls input[type=number]')"
    page.value(f"{box}.value = 5; {box}.dispatchEvent(new Event('input'))")
    assert (
        page.value("[...document.querySelectorAll('#best tbody tr')].map((row) => row.cells[0].innerText)") == ["b"] * 2
    )
    assert page.value("document.querySelectorAll('#front circle.off').length") == 3
    assert page.value("document.querySelectorAll('#front circle.ring').length") == 1
    page.value(f"{box}.value = ''; {box}.dispatchEvent(new Event('input'))")
    load = (
        "[...document.querySelectorAll('#controls select')].find((x) => x.parentNode.innerText.startsWith('payload'))"
    )
    for place, rows in ((1, 8), (2, 4), (0, 4)):
        page.value(f"{{const x = {load}; x.selectedIndex = {place}; x.dispatchEvent(new Event('change'));}}")
        assert page.value("document.querySelectorAll('#best tbody tr').length") == rows
    assert page.complaints == []
    page.close()


def test_a_row_gives_its_commands(browse, address):
    """By keyboard: draw 0 of the case with the load that is worst, in the page's own folder, and the law's own keys."""
    page = browse()
    page.go(address)
    row = "document.querySelectorAll('#best tbody tr')[1]"
    page.value(f"{row}.dispatchEvent(new KeyboardEvent('keydown', {{key: 'Enter'}}))")
    second = best_choices(SUMMARY)[1]
    folder = address.removeprefix("file://").rpartition("/")[0]
    index = next(
        i for i in range(len(TABLE["index"])) if TABLE["case"][i] == second.worst.case and TABLE["draw"][i] == 0
    )
    index += "ab".index(second.controller)
    said = page.value("document.querySelector('#rerun').textContent")
    assert said == f"torquebench run --from-sweep {folder} --index {index} -o again"
    words = shlex.split(page.value("document.querySelector('#narrow').textContent"))
    grid = f'sweep.grid={{"{LAM}": [{second.worst.values[LAM]:g}], "{MASS}": [0, 2]}}'
    assert words == ["torquebench", "sweep", f"{folder}/sweep.yaml", "--set", grid, "-o", "alone"]
    assert page.value(f"{row}.getAttribute('aria-selected')") == "true"
    assert page.value("document.querySelectorAll('#front circle.chosen').length") == 1
    page.close()


def test_a_sweep_without_a_completed_run_has_a_page(browse, tmp_path):
    """Nothing complained of; the front says that there is none."""
    for name, broken in (("all", "ab"), ("one", "b")):
        table = made("ab", 3, lambda law, draw, x, broken=broken: None if law in broken else run(law, draw, x), GRID)
        (tmp_path / f"{name}.html").write_bytes(page_of(table, found=[]))
        page = browse()
        page.go((tmp_path / f"{name}.html").as_uri())
        assert page.complaints == []
        assert page.value("document.querySelectorAll('#front circle[data-i]').length") == (0 if name == "all" else 2)
        page.close()


def test_the_commands_of_a_sweep_run_as_pasted(browse, tmp_path, monkeypatch):
    """One row gives its metrics again; the choice alone gives the rows of the sweep, changed on the command line."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(SMALL)
    sweep = ["sweep", "small.yaml", "--set", "sweep.draws=2", "--set", "run.duration=0.61", "--out", "its sweep"]
    assert main([*sweep, "--executor", "threads", "--workers", "1"]) == 0
    page = browse()
    page.go((tmp_path / "its sweep" / "report.html").as_uri())
    page.value("[...document.querySelectorAll('#best tbody tr')].find((row) => row.innerText.includes('band')).click()")
    again, alone = (
        shlex.split(page.value(f"document.querySelector('{name}').textContent")) for name in ("#rerun", "#narrow")
    )
    page.close()
    for words in (again, [*alone, "--executor", "threads", "--workers", "1"]):
        assert words[0] == "torquebench"
        assert main(words[1:]) == 0
    whole, own = (dict(np.load(tmp_path / name / "results.npz")) for name in ("its sweep", "alone"))
    (result,) = json.loads((tmp_path / "again" / "metrics.json").read_bytes())["controllers"].values()
    row = int(again[again.index("--index") + 1])
    assert result["rmse"]["value"] == whole["rmse"][row]
    phi = "controllers.*.gains.phi"
    same = (whole[phi] == own[phi][own["controller"] == "band"][0]) & (whole["controller"] == "band")
    assert whole["rmse"][same].tolist() == own["rmse"][own["controller"] == "band"].tolist()
