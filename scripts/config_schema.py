"""Write configs/schema.json, which lets editors check and complete configs; run after a change of any key."""

from __future__ import annotations

import json
from pathlib import Path

import torquebench.laws  # noqa: F401  (registers the built-in laws)
from torquebench.experiment import experiment_json_schema

TARGET = Path(__file__).resolve().parents[1] / "configs" / "schema.json"

if __name__ == "__main__":
    TARGET.write_text(json.dumps(experiment_json_schema(), indent=2) + "\n", encoding="utf-8")
