"""Where models and configs lie on disk: from a model's name to its folder, its MJCF file, its scene and cameras."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from torquebench.errors import ModelError, did_you_mean, did_you_mean_path
from torquebench.shipped import data_root as data_root

MJCF = r"\.xml"
"""Ending of a model's file name, a regular expression."""
PRESETS = "presets.yaml"
"""File of an arm's folder that gives motions and gains names; no part of the arm."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


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


def mjcf_path(source: str | Path) -> Path:
    """Return the MJCF file of a model's name, or `source` itself when it is the path of an ``.xml`` file.

    Raises:
        ModelError: there is no such model or file.
    """
    if isinstance(source, Path) or str(source).endswith(".xml"):
        path = Path(source)
        if not path.is_file():
            raise ModelError(f"{path}: no such file{did_you_mean_path(path, MJCF)}")
        return path
    return model_folder(source) / f"{source}.xml"


CAMERAS = ("overview", "side")
"""Cameras of an arm whose files define none."""


def scene_path(model: str) -> Path | None:
    """Return an arm's scene file, ``scene.xml`` beside its MJCF file; None if there is none.

    Raises:
        ModelError: there is no such arm.
    """
    path = mjcf_path(model).with_name("scene.xml")
    return path if path.is_file() else None


def camera_names(model: str) -> tuple[str, ...]:
    """Names of an arm's cameras: those in its scene file or MJCF file, else `CAMERAS`.

    Raises:
        ModelError: there is no such arm, or its file cannot be read.
    """
    path = scene_path(model) or mjcf_path(model)
    try:
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ElementTree.ParseError) as error:
        raise ModelError(f"{path}: not a readable MJCF file ({error})") from error
    return tuple(name for camera in root.iter("camera") if (name := camera.get("name"))) or CAMERAS
