"""A run, or a path of the tool, that starts at a keyframe of the arm's file: ``initial_q: key:home``."""

from __future__ import annotations

from typing import Any

from torquebench.errors import ModelError, nearest
from torquebench.experiment.arm import ArmValue
from torquebench.experiment.groups import Group
from torquebench.experiment.source import Document
from torquebench.experiment.values import Here
from torquebench.experiment.yaml_tree import BROKEN, Map, Seq
from torquebench.kernel import Array
from torquebench.keys import declared_keys
from torquebench.references import REFERENCES
from torquebench.robot.loading import keyframes

KEY = "key:"
"""Before the name of a keyframe."""


def _keyframes(model: Any, document: Document, top: Group) -> dict[str, Array] | None:
    """Return an arm's keyframes; None where there is no such arm, which is told where the arm is read."""
    arm = ArmValue().read(model, Here(document.copy(), top, ("plant", "model")))
    try:
        return None if arm is BROKEN else keyframes(arm)
    except ModelError:
        return None


def write_keyframe(document: Document, top: Group) -> None:
    """Put numbers in place of keyframes: where a path of the tool begins, and where the run and its reference start.

    Args:
        document: The config; changed.
        top: Its sections.
    """
    root: Any = document.root
    run, plant, reference = (root.get(name) for name in ("run", "plant", "reference"))
    model = plant.get("model") if isinstance(plant, Map) else None
    if isinstance(reference, Map):
        _pose_at(reference, ("reference", "start"), model, document, top)
    pose = _pose_at(run, ("run", "initial_q"), model, document, top) if isinstance(run, Map) else None
    kind = reference.get("kind") if isinstance(reference, Map) else None
    if pose is not None and kind in tuple(REFERENCES) and "origin" not in reference:
        if any(declared.name == "origin" for declared in declared_keys(REFERENCES.find(kind))):
            reference.put("origin", pose, *run.places["initial_q"])


def _pose_at(node: Map, path: tuple[str, str], model: Any, document: Document, top: Group) -> Any:
    """Put numbers in place of a keyframe, and return them; BROKEN where there is none, None where numbers stand there.

    Args:
        node: A section.
        path: Its key that may name a keyframe.
        model: The arm.
        document: The config; told what is wrong.
        top: Its sections.
    """
    key, given = path[-1], node.get(path[-1])
    if not (isinstance(given, str) and given.startswith(KEY)):
        return None
    places, name = node.places[key], given.removeprefix(KEY)
    pose: Any = BROKEN
    poses = _keyframes(model, document, top)
    if poses is not None and name in poses:
        pose = Seq(poses[name].tolist(), [places[1]] * len(poses[name]))
    elif poses is not None:
        near = nearest(name, poses) or ""
        names = ", ".join(KEY + each for each in poses)
        numbers = "numbers, or home: it has none at all" if key == "initial_q" else "numbers: it has none at all"
        wanted = "" if near else f"one of {names}" if names else numbers
        text = f"the arm's file has no keyframe '{name}'"
        document.add(path, text, wanted=wanted, nearest=KEY + near if near else "")
    node.put(key, pose, *places)
    return pose
