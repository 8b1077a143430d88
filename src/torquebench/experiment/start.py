"""A run that starts at a keyframe of the arm's file: ``initial_q: key:home``, with its reference."""

from __future__ import annotations

from typing import Any

from torquebench.errors import ModelError, nearest
from torquebench.experiment.source import Document
from torquebench.experiment.yaml_tree import BROKEN, Map, Seq
from torquebench.kernel import Array
from torquebench.keys import declared_keys
from torquebench.references import REFERENCES
from torquebench.robot.loading import keyframes

KEY = "key:"
"""Before the name of a keyframe."""


def _keyframes(model: Any) -> dict[str, Array] | None:
    """Return an arm's keyframes; None where there is no such arm, which is told where the arm is read."""
    try:
        return keyframes(model) if isinstance(model, str) else None
    except ModelError:
        return None


def write_keyframe(document: Document) -> None:
    """Put numbers in place of the keyframe at which the run starts, and let its reference start there."""
    root: Any = document.root
    run, plant, reference = (root.get(name) for name in ("run", "plant", "reference"))
    given = run.get("initial_q") if isinstance(run, Map) else None
    if not (isinstance(run, Map) and isinstance(given, str) and given.startswith(KEY)):
        return
    places, name = run.places["initial_q"], given.removeprefix(KEY)
    pose: Any = BROKEN
    poses = _keyframes(plant.get("model") if isinstance(plant, Map) else None)
    if poses is not None and name in poses:
        pose = Seq(poses[name].tolist(), [places[1]] * len(poses[name]))
    elif poses is not None:
        near = nearest(name, poses) or ""
        names = ", ".join(KEY + each for each in poses)
        wanted = "" if near else f"one of {names}" if names else "numbers, or home: it has none at all"
        text = f"the arm's file has no keyframe '{name}'"
        document.add(("run", "initial_q"), text, wanted=wanted, nearest=KEY + near if near else "")
    run.put("initial_q", pose, *places)
    kind = reference.get("kind") if isinstance(reference, Map) else None
    if kind in tuple(REFERENCES) and "origin" not in reference:
        if any(declared.name == "origin" for declared in declared_keys(REFERENCES.find(kind))):
            reference.put("origin", pose, *places)
