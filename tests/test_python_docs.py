"""The examples of docs/python.md run as they stand."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib as mpl

PAGE = (Path(__file__).parents[1] / "docs" / "python.md").read_text(encoding="utf-8")


def test_the_examples_run_in_order(tmp_path, monkeypatch):
    """All of them in one Python, one after another, in an empty folder; they leave what they say."""
    monkeypatch.chdir(tmp_path)
    names = {}
    with mpl.rc_context({"backend": "agg"}):
        for block in re.findall(r"^```python\n(.*?)^```$", PAGE, flags=re.DOTALL | re.MULTILINE):
            exec(compile(block, "docs/python.md", "exec"), names)
    assert Path("drawn/torque.pdf").is_file()
    assert Path("runs/mine/manifest.json").is_file()
    assert names["run"].q.shape == (500, 6)
    assert not names["comparison"]["agrees"].all()
