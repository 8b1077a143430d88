"""From two experiments to the settings that make one of the other, as ``--set`` takes them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from torquebench.experiment.dump import plain_values
from torquebench.experiment.schema import Experiment


def settings_between(before: Experiment, after: Experiment) -> tuple[str, ...]:
    """Return the texts ``key=value`` that make `after` of `before`, which has the same arm and controllers' names."""
    old, new = before.to_dict(), after.to_dict()
    for values in (old, new):
        values["plant"].pop("model")
        values["controllers"] = {keys["name"]: keys for keys in values["controllers"]}
    if not isinstance(new["chain"], str):  # a name stands for its keys, of which one can be set
        old["chain"] = plain_values(replace(before.chain, name="custom"))
    return tuple(_changes("", old, new))


def _changes(path: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    for key, value in new.items():
        at, was = f"{path}{key}", old.get(key)
        if isinstance(value, Mapping) and isinstance(was, Mapping) and set(was) <= set(value):  # else it is another law
            yield from _changes(f"{at}.", was, value)
        elif value != was:
            yield f"{at}={_flow(value)}"


def _flow(value: Any) -> str:
    """Return a plain value as YAML in one line, numbers with twelve digits."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key}: {_flow(item)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_flow, value))}]"
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    return f"{value:.12g}" if isinstance(value, float) else str(value)
