"""Where models and configs live on disk, and how a model's name becomes a folder."""

from __future__ import annotations

import os
import re
from pathlib import Path

from torquebench.errors import ModelError, did_you_mean

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


def data_root() -> Path:
    """Return the folder that holds ``models/`` and ``configs/``.

    The checkout wins over the copy inside an installed wheel: an editable install leaves a stale copy behind.
    The environment variable ``TORQUEBENCH_DATA`` wins over both.
    """
    if chosen := os.environ.get("TORQUEBENCH_DATA"):
        return Path(chosen)
    checkout = Path(__file__).resolve().parents[3]
    if (checkout / "pyproject.toml").is_file() and (checkout / "models").is_dir():
        return checkout
    return Path(__file__).resolve().parents[1] / "_data"


def model_names() -> tuple[str, ...]:
    """Names of the models that can be used in a config, sorted."""
    folder = data_root() / "models"
    return tuple(sorted(p.name for p in folder.iterdir() if (p / f"{p.name}.xml").is_file())) if folder.is_dir() else ()


def model_folder(name: str) -> Path:
    """Return the folder of the model called `name`.

    Raises:
        ModelError: the name is not a plain name (a path, say), or no such model exists.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ModelError(f"model name {name!r} is not a plain name{did_you_mean(name, model_names())}")
    if name not in model_names():
        raise ModelError(f"unknown model '{name}'{did_you_mean(name, model_names())}")
    folder = (data_root() / "models" / name).resolve()
    if not folder.is_relative_to((data_root() / "models").resolve()):
        raise ModelError(f"model '{name}' lies outside the models folder")
    return folder
