"""The JSON schema for editors is current, complete, and agrees with the loader."""

from __future__ import annotations

import json

from tests.experiment.examples import ALL, properties
from torquebench.experiment import experiment_json_schema
from torquebench.laws.base import find_law, law_names
from torquebench.robot.library import data_root


def shipped_laws() -> list[str]:
    """Names of the laws of this package, without those that other tests register."""
    return [name for name in law_names() if find_law(name).function.__module__.startswith("torquebench.")]


def test_committed_schema_is_current() -> None:
    """configs/schema.json is what the code says; if not, run scripts/config_schema.py."""
    stored = json.loads((data_root() / "configs" / "schema.json").read_text())
    assert stored == json.loads(json.dumps(experiment_json_schema(shipped_laws())))


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
    schema = experiment_json_schema(["smc", "linear-band-smc"])
    described = {key for key, _ in properties(schema)}
    written = {
        line.strip().removeprefix("- ").partition(":")[0]
        for name in ("good", "step", "ramp", "analytic")
        for line in ALL[name].splitlines()
    }
    assert written == described
