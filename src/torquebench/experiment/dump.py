"""Writing a resolved experiment: YAML that reads back equal, and a hash that identifies it."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import yaml

from torquebench.experiment.schema import ControllerKeys, Experiment
from torquebench.experiment.yaml_tree import NUMBER


class _Dumper(yaml.SafeDumper):
    """Quotes whatever either YAML 1.1 or the subset read here would not take for text."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write every value out: aliases are not read back."""
        return True


# YAML 1.1, which PyYAML writes for, takes 1e-3 for text.
_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", NUMBER, list("-+.0123456789"))


def plain(experiment: Experiment) -> dict[str, Any]:
    """Return the resolved experiment as plain values, keys as in the file, every default filled in."""
    data = experiment.model_dump(mode="json", exclude_none=True)
    if not data["fuzzy"]:
        del data["fuzzy"]
    for controller in data["controllers"]:
        options, gains = controller.pop("options"), controller.pop("gains")
        common = {key: controller.pop(key) for key in ControllerKeys.model_fields}
        expect = common.pop("expect")
        fuzzy = {"fuzzy": controller.pop("fuzzy")} if "fuzzy" in controller else {}
        controller.update(common | options | fuzzy | {"gains": gains, "expect": expect})
    return data


def dump_experiment(experiment: Experiment) -> str:
    """Return the resolved experiment as YAML that loads to an equal experiment."""
    return yaml.dump(plain(experiment), Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100)


def config_hash(experiment: Experiment) -> str:
    """Return the SHA-256 of the resolved experiment as canonical JSON."""
    return canonical_hash(plain(experiment))


def canonical_hash(tree: Any) -> str:
    """Return the SHA-256 of plain values as canonical JSON."""
    text = json.dumps(tree, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
