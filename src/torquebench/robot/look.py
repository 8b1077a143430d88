"""How an arm can be looked at: the file with its look, and the names of its cameras; read without MuJoCo."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from torquebench.errors import ModelError
from torquebench.robot.loading import mjcf_path

CAMERAS = ("overview", "side")
"""Cameras that an arm has whose files have none."""


def scene_path(model: str) -> Path | None:
    """Return the file with an arm's look, ``scene.xml`` beside its own file, or None when it has none.

    Raises:
        ModelError: there is no such arm.
    """
    path = mjcf_path(model).with_name("scene.xml")
    return path if path.is_file() else None


def camera_names(model: str) -> tuple[str, ...]:
    """Names of the cameras of an arm: those of its look or its own file, else `CAMERAS`.

    Raises:
        ModelError: there is no such arm, or its file cannot be read.
    """
    path = scene_path(model) or mjcf_path(model)
    try:
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ElementTree.ParseError) as error:
        raise ModelError(f"{path}: not a readable MJCF file ({error})") from error
    return tuple(name for camera in root.iter("camera") if (name := camera.get("name"))) or CAMERAS
