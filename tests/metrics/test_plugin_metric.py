"""A metric of a user's own: one function in a plug-in file, and it is everywhere that the built-in ones are."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import QUICK
from torquebench import load_trajectory
from torquebench.errors import RegistryError
from torquebench.metrics import METRICS, JointRecord, applicable, metric
from torquebench.registry import restored

PLUGIN = '''\
"""A metric of a user."""
import numpy as np
from torquebench.metrics import metric

@metric("p99_error", title="99th percentile of the error", unit="rad", over_joints="worst", column="p99")
def p99_error(run):
    """99th percentile of abs(e) over the window."""
    return np.percentile(np.abs(run.e[run.window]), 99, axis=0)
'''
SWEEP = QUICK + "sweep: {draws: 2, grid: {plant.payload.mass: [0, 2]}, keep: {worst: 1, by: p99_error}}\n"
Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, registries: None) -> Path:
    """A folder with an experiment, a sweep and the plug-in, which is also the current one."""
    monkeypatch.chdir(tmp_path)
    for name, text in {"quick.yaml": QUICK, "sweep.yaml": SWEEP, "mine.py": PLUGIN}.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_a_plugin_metric_is_in_files_table_and_page_of_a_run(folder: Path, command: Command) -> None:
    """After the built-in ones in metrics.json, with its unit in the table, and on the page; its value is numpy's."""
    status, out, err = command("run", "quick.yaml", "--plugin", "mine.py", "--no-figures", "--out", "out")
    assert (status, err) == (0, "")
    assert "p99 [mrad]" in out
    stored = json.loads((folder / "out" / "metrics.json").read_text())["controllers"]
    run = load_trajectory(folder / "out" / "conventional" / "trajectory.npz")
    expected = np.percentile(np.abs(run.q_ref - run.q)[200:], 99, axis=0)
    keys = list(stored["conventional"])
    assert (keys, keys[-1]) == ([info.key for info in applicable(tool=False)], "p99_error")
    assert stored["conventional"]["p99_error"]["per_joint"] == expected.tolist()
    assert stored["conventional"]["p99_error"]["value"] == expected.max()
    page = (folder / "out" / "report.html").read_text()
    assert "p99 [mrad]" in page
    assert "99th percentile of the error" in page


def test_a_plugin_metric_is_in_the_table_of_a_sweep_and_chooses_what_is_kept(folder: Path, command: Command) -> None:
    """A column of results.npz, a mean on the terminal and on the page, and `sweep.keep.by` takes it."""
    words = ("--plugin", "mine.py", "--executor", "threads", "--workers", "1", "--out", "out")
    with restored():
        status, out, err = command("sweep", "sweep.yaml", *words)
    assert status == 0, err
    assert "p99 [mrad]" in out
    table = dict(np.load(folder / "out" / "results.npz"))
    assert list(table)[-2:] == ["time_in_band", "p99_error"]
    assert (table["p99_error"] > 0.0).all()
    (kept,) = (folder / "out" / "trajectories").glob("*-conventional.npz")
    own = table["p99_error"][table["controller"] == "conventional"]
    assert table["p99_error"][int(kept.name.split("-")[0])] == own.max() > own.min()
    assert "p99 [mrad]" in (folder / "out" / "report.html").read_text()
    status, _, err = command("sweep", "sweep.yaml", "--out", "other")
    assert status == 2
    assert "sweep.keep.by" in err


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("return 1.0", "metric 'p99_error': returned shape (), wanted (6,): a number for each joint"),
        ("return run.nothing", "metric 'p99_error': AttributeError: 'JointRecord' object has no attribute 'nothing'"),
    ],
)
def test_a_metric_that_cannot_be_used_is_named(folder: Path, command: Command, body: str, message: str) -> None:
    """A metric that raises, or returns anything but a number for each joint, ends the command and says so."""
    text = PLUGIN.replace("return np.percentile(np.abs(run.e[run.window]), 99, axis=0)", body)
    (folder / "mine.py").write_text(text)
    status, _, err = command("run", "quick.yaml", "--plugin", "mine.py", "--no-figures", "--out", "out")
    assert status == 3
    assert message in err
    assert "Traceback" not in err


def test_a_metric_declares_itself_or_is_refused() -> None:
    """A taken key, one that is not in the form of keys, and words that mean nothing are refused; nothing is added."""
    before = METRICS.names()

    def formula(run: JointRecord) -> np.ndarray:
        return run.tau_max

    for key, changes, message in (
        ("rmse", {}, "a metric named 'rmse' is already registered"),
        ("P99", {}, "lower-case letters, digits and '_'"),
        ("p99-error", {}, "lower-case letters, digits and '_'"),
        ("p99", {"better": "less"}, "wanted better 'lower' or 'higher'"),
        ("p99", {"over_joints": "median"}, "'mean', 'worst' or 'rms'"),
    ):
        with pytest.raises(RegistryError, match=message):
            metric(key, title="99th percentile", unit="rad", **changes)(formula)
    assert METRICS.names() == before


def test_without_docstrings_pages_say_the_same():
    """`python -OO` removes docstrings; metrics and chains have their words all the same."""
    shown = "from torquebench.metrics import METRICS; from torquebench.chain.chain import ABOUT; "
    shown += "print([m.meaning for m in METRICS.values()], {k: (x.summary, x.note) for k, x in ABOUT.items()})"
    texts = [
        subprocess.run([sys.executable, *how, "-c", shown], capture_output=True, text=True, check=True).stdout
        for how in ([], ["-OO"])
    ]
    assert len(texts[0]) > 1000
    assert texts[0] == texts[1]
