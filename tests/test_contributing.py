"""The examples of CONTRIBUTING.md: each adds a kind from one file, and an experiment uses all of them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from torquebench import Experiment, Outcome, load_plugin, run_experiment
from torquebench.shipped import data_root

EXAMPLES = re.findall(r"```python\n(.*?)```", (data_root() / "CONTRIBUTING.md").read_text(), flags=re.DOTALL)
KINDS = [text for text in EXAMPLES if "@command" not in text]
EXPERIMENT = {
    "name": "kinds",
    "plant": {"engine": "in-oil", "model": "two-link", "damping": 2.0},
    "controllers": [{"name": "damped", "law": "damper", "gains": {"kd": 1.0}}],
    "reference": {"kind": "exponential", "target": 0.3},
    "chain": "worn",
    "disturbances": [{"kind": "kick", "channel": "torque", "size": [1.0, 0.0], "at": 0.1}],
    "run": {"duration": 0.6, "metrics_from": 0.05},
}


@pytest.fixture
def plugins(tmp_path: Path, registries: None) -> list[Path]:
    """File of each example; what they register is forgotten in the end."""
    files = []
    for i, text in enumerate(KINDS):
        files.append(tmp_path / f"kind_{i}.py")
        files[-1].write_text(text)
    return files


def test_each_kind_is_added_by_one_file(plugins: list[Path]) -> None:
    """A law, a reference, a disturbance, a chain, a plant, a metric and a figure: no file of the package is touched."""
    for file in plugins:
        load_plugin(file)
    result = run_experiment(Experiment.from_dict(EXPERIMENT))
    assert result.outcomes == {"damped": Outcome.COMPLETED}
    assert "chain worn" in result.conditions
    assert "torque kick at 0.1 s for 0.05 s" in result.conditions
    (row,) = result.to_dataframe().to_dict("records")
    assert 0.0 < row["median_error"]
    assert result.figure("largest-error").axes[0].get_xlabel() == "time [s]"


def test_a_command_is_one_file() -> None:
    """The command of the example does what its docstring says."""
    (text,) = [text for text in EXAMPLES if "@command" in text]
    names: dict[str, object] = {}
    exec(compile(text, "joints.py", "exec"), names)
    done = CliRunner().invoke(names["joints"], ["two-link"])  # type: ignore[arg-type]
    assert done.exit_code == 0, done.output
