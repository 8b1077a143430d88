"""Finds models and configs on disk: from a model's name to its folder, its MJCF file, its scene and cameras."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import TypeAlias

from torquebench.errors import ModelError, did_you_mean, did_you_mean_path
from torquebench.robot.described import described_arm
from torquebench.shipped import data_root as data_root
from torquebench.shipped import model_names as model_names

MJCF = r"\.(?:xml|urdf|mjcf)"
"""Ending of the name of an arm's file, a regular expression."""
MAX_BYTES = 4 * 1024 * 1024
"""Size of an arm's file, at most."""
PRESETS = "presets.yaml"
"""File of an arm's folder that gives motions and gains names; no part of the arm."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


@dataclasses.dataclass(frozen=True)
class ArmFile:
    """An arm as its file describes it, held in memory: two with the same name and text are the same arm."""

    name: str
    text: str = dataclasses.field(repr=False)
    """MJCF or URDF; once it is read, one that stands alone."""
    remarks: tuple[str, ...] = dataclasses.field(default=(), compare=False)
    """What was left out or changed of the file."""
    origin: Path | None = dataclasses.field(default=None, compare=False)
    """The file."""

    def __str__(self) -> str:
        """Name of the file that keeps it beside results."""
        return f"{self.name}.xml"

    @property
    def digest(self) -> str:
        """SHA-256 of the text."""
        return hashlib.sha256(self.text.encode()).hexdigest()


ArmSource: TypeAlias = str | Path | ArmFile
"""An arm: the name of a shipped one, a file, or one that was read from a file."""


def is_path(text: str) -> bool:
    """Whether an arm is given as the path of a file instead of a name."""
    return re.search(rf"{MJCF}$", text, re.IGNORECASE) is not None


def file_of_arm(source: ArmSource) -> ArmFile:
    """Return an arm's file as it is.

    Raises:
        ModelError: there is no such arm, or its file is too large or no text.
    """
    if isinstance(source, ArmFile):
        return source
    path = mjcf_path(source)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ModelError(f"{path}: larger than {MAX_BYTES // 2**20} MiB")
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise ModelError(f"{path}: not a readable MJCF file ({error})") from error
    return ArmFile(arm_name(path.stem), text, origin=path)


def arm_name(text: str) -> str:
    """Return a plain name made of that of a file, or of a path."""
    return plain_name(re.sub(rf"{MJCF}$", "", re.split(r"[/\\]", text)[-1], flags=re.IGNORECASE))


def plain_name(text: str) -> str:
    """Return a name that an arm may have, made of a text."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", text).strip("-_")[:64] or "arm"


def model_folder(name: str) -> Path:
    """Return the folder of the model called `name`.

    Raises:
        ModelError: the name is not a plain name (a path, say), or no such model exists.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ModelError(f"model name {name!r} is not a plain name{did_you_mean(name, model_names())}")
    return _folder_in(data_root() / "models", name)


@functools.lru_cache(maxsize=64)
def _folder_in(models: Path, name: str) -> Path:
    if name not in model_names():
        raise ModelError(f"unknown model '{name}'{did_you_mean(name, model_names())}")
    folder = (models / name).resolve()
    if not folder.is_relative_to(models.resolve()):
        raise ModelError(f"model '{name}' lies outside the models folder")
    return folder


def mjcf_path(source: str | Path) -> Path:
    """Return the file of an arm's name, or `source` itself when it is the path of an MJCF or URDF file.

    A name is that of a folder in ``models/``, or one of the package ``robot_descriptions``.

    Raises:
        ModelError: there is no such model or file.
    """
    if isinstance(source, Path) or is_path(source):
        path = Path(source)
        if not path.is_file():
            raise ModelError(f"{path}: no such file{did_you_mean_path(path, MJCF)}")
        return path
    try:
        return model_folder(source) / f"{source}.xml"
    except ModelError:
        if described := described_arm(source):
            return described
        raise


CAMERAS = ("overview", "side")
"""Cameras of an arm whose files define none."""


def scene_path(source: ArmSource) -> Path | None:
    """Return an arm's scene file, ``scene.xml`` beside its file; None if there is none.

    Of an arm in memory only one that ``torquebench import`` wrote counts: others may show more than the arm.

    Raises:
        ModelError: there is no such arm.
    """
    file = source.origin if isinstance(source, ArmFile) else mjcf_path(source)
    path = None if file is None else file.with_name("scene.xml")
    if path is None or not path.is_file():
        return None
    return path if has_imported_looks(path) or not isinstance(source, ArmFile) else None


LOOKS = "<!-- The arm with the looks of "
"""Beginning of the scene file that ``torquebench import`` writes."""


def has_imported_looks(path: Path) -> bool:
    """Return whether a scene file is one that ``torquebench import`` wrote, whose meshes may be gone."""
    with path.open(encoding="utf-8", errors="replace") as text:
        return text.read(len(LOOKS)) == LOOKS


def camera_names(source: ArmSource) -> tuple[str, ...]:
    """Names of an arm's cameras: those in its scene file or MJCF file, else `CAMERAS`.

    Raises:
        ModelError: there is no such arm, or its file cannot be read.
    """
    arm = file_of_arm(scene_path(source) or source)
    try:
        root = ElementTree.fromstring(arm.text)
    except ElementTree.ParseError as error:
        raise ModelError(f"{arm.origin}: not a readable MJCF file ({error})") from error
    return tuple(name for camera in root.iter("camera") if (name := camera.get("name"))) or CAMERAS
