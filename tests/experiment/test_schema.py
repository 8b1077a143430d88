"""The JSON schema for editors and the key reference are current, complete, and agree with the loader."""

from __future__ import annotations

import json
import runpy

import pytest

from tests.experiment.examples import ALL, ARENA, FALSIFY, SWEEP, TOOL, TUNE, VARIED, properties
from torquebench.experiment import experiment_json_schema
from torquebench.laws.law import find_law, law_names
from torquebench.robot.library import data_root


def shipped_laws() -> list[str]:
    """Names of the laws of this package, without those that other tests register."""
    return [name for name in law_names() if find_law(name).function.__module__.startswith("torquebench.")]


def test_committed_schema_is_current() -> None:
    """configs/schema.json is what the code says; if not, run scripts/config_schema.py."""
    stored = json.loads((data_root() / "configs" / "schema.json").read_text())
    assert stored == json.loads(json.dumps(experiment_json_schema(shipped_laws())))


def test_committed_key_reference_is_current() -> None:
    """docs/config.md is what the code says; if not, run scripts/config_schema.py."""
    script = runpy.run_path(str(data_root() / "scripts" / "config_schema.py"))
    written = script["reference"](experiment_json_schema(shipped_laws()))
    assert (data_root() / "docs" / "config.md").read_text(encoding="utf-8") == written


def test_committed_tables_of_chains_are_current() -> None:
    """docs/chains.md has the numbers and sources of the code; if not, run scripts/config_schema.py."""
    script = runpy.run_path(str(data_root() / "scripts" / "config_schema.py"))
    text = (data_root() / "docs" / "chains.md").read_text(encoding="utf-8")
    assert script["chains_page"](text) == text


def test_key_reference_has_every_key_in_a_table_of_four_columns() -> None:
    """Each key of the schema has as many rows as there are sections with it; no cell breaks its table."""
    text = (data_root() / "docs" / "config.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.replace("\\|", "").count("|") == 5 for line in rows)
    described = {key for key, _ in properties(experiment_json_schema(shipped_laws()))}
    assert {line.split("`")[1] for line in rows if line.startswith("| `")} == described
    for law in map(find_law, shipped_laws()):
        section = text.partition(f"### law: {law.name}\n")[2].partition("\n### ")[0].partition("\n## ")[0]
        listed = [line.split("`")[1] for line in section.splitlines() if line.startswith("| `")]
        assert listed == [*law.options, *["fuzzy"] * len(law.rules), *law.gains]


WRITTEN = (
    "good",
    "step",
    "ramp",
    "analytic",
    "fuzzy",
    "scenario",
    "driven",
    "filtered",
    "tolerance",
    "single",
    "flexible",
)
FACTS = [
    ("initial_q", "the reference starts there too, unless it has an origin of its own; otherwise it starts at zero"),
    ("expect", "failed makes a failing run the expected outcome"),
    ("draw", "Number of the random draw under one seed"),
    ("amplitude", " for slide joints"),
    ("target", "[rad], in m for slide joints"),
    ("integrator", "euler is semi-implicit"),
    ("relative", " [1]"),
    ("timestep", "| number, > 0 | `0.001` |"),
    ("equivalent_control", "`true`"),
    ("surface", "Sliding variable: "),
    ("compensation", "| `fuzzy`, `clipped-sum`, `off` | `fuzzy` |"),
    ("band", "| `saturation`, `sign`, `off` | `saturation` |"),
    ("metrics_from", "| see meaning |"),
    ("phi", "| vector, > 0 | "),
]


@pytest.mark.parametrize(("key", "fact"), FACTS)
def test_key_reference_states_what_users_ask(key: str, fact: str) -> None:
    """What a value means that its name does not tell, and limits and defaults, are in every row of the key."""
    text = (data_root() / "docs" / "config.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith(f"| `{key}` |")]
    assert rows
    assert all(fact in row for row in rows)


def test_schema_describes_every_key_with_its_unit() -> None:
    """Every key has a description, every numeric key a unit in it; laws' gains and options are all there."""
    found = list(properties(experiment_json_schema(shipped_laws())))
    keys = {key for key, _ in found}
    for law in map(find_law, shipped_laws()):
        assert {*law.gains, *law.options} <= keys
    for key, described in found:
        assert described.get("description"), key
        kinds = [described, *described.get("oneOf", [])]
        if any(kind.get("type") in ("number", "integer") for kind in kinds):
            assert "]" in described["description"], key


def test_schema_and_loader_know_the_same_keys() -> None:
    """The keys of the fully written examples are those of the JSON schema, none more and none less."""
    schema = experiment_json_schema(["smc", "linear-band-smc", "fuzzy-linear-band-smc"])
    described = {key for key, _ in properties(schema)}
    written = {
        line.strip().removeprefix("- ").partition(":")[0]
        for text in (SWEEP, FALSIFY, TUNE, ARENA, *(ALL[name] for name in WRITTEN), *TOOL)
        for line in text.splitlines()
        if not line.strip().startswith("- [")
    }
    # the names of the fuzzy systems, and the keys that the sweep varies; what extends another needs another file, and a
    # curved term stands in one line with its name
    assert written == described - {"extends", "figures", "centre", "slope"} | {"three", "list"} | VARIED
