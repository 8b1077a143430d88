"""Write ``torquebench/__init__.pyi``, which tells editors and mypy where each public name is from."""

from __future__ import annotations

from pathlib import Path

import torquebench

STUB = Path(torquebench.__file__).with_suffix(".pyi")


def stub() -> str:
    """Return the text of the stub."""
    found = sorted((module, name) for module, names in torquebench._HOMES.items() for name in names)
    lines = [f"from torquebench.{module} import {name} as {name}" for module, name in found]
    return "\n".join(["# written by scripts/public_names.py", *lines, "", "__version__: str", ""])


if __name__ == "__main__":
    STUB.write_text(stub(), encoding="utf-8")
