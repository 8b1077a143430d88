"""A controller in a config: its own keys, and those that its law declares."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import MISSING, dataclass
from typing import Annotated, Any, Literal

import torquebench.laws  # noqa: F401  (registers the built-in laws)
from torquebench.experiment.groups import SLUG, Group, NumberOrList, OneOf, Spec, always, option_type, spec_of
from torquebench.fuzzy import BUILTIN
from torquebench.keys import Key, Vector, declared_keys
from torquebench.laws.declare import RESERVED, Gain
from torquebench.laws.law import Law, find_law, law_names

MAX_CONTROLLERS = 64


@dataclass(frozen=True)
class Controller:
    """One controller: a law, the choices that set its form, and its gains."""

    name: Annotated[
        str, Key("Name of the controller, unique in the file; also the name of its folder, so not figures"), SLUG
    ]
    law: Annotated[str, Key("Name of the torque law")]
    options: dict[str, str | bool]
    """Option name -> value; in the file at the controller's level."""
    gains: dict[str, Vector]
    """Gain name -> one number, or one for each joint."""
    expect: Annotated[
        Literal["completed", "failed"],
        Key(
            "Outcome that counts as right; failed makes a failing run the expected outcome, and one that completes the "
            "wrong one"
        ),
    ] = "completed"
    fuzzy: str | None = None
    """Name of the law's fuzzy system, of a law that has one."""


OWN_KEYS = tuple(declared.name for declared in declared_keys(Controller))
"""Keys that every controller has, whatever its law."""


class Laws(OneOf):
    """A controller, whose law decides which options and gains there are.

    Args:
        only: Names of the laws to choose from; all that are registered if left out.
    """

    def __init__(self, only: Iterable[str] | None = None) -> None:
        self.tag, self.meaning = "law", "Name of the torque law."
        self.more = "a law of your own needs --plugin FILE, the file that registers it"
        self._only = None if only is None else tuple(sorted(only))

    def names(self) -> tuple[str, ...]:
        """Names of the registered laws, or of those that were chosen."""
        return law_names() if self._only is None else self._only

    def group(self, name: str) -> Group:
        """Return the keys of a controller with a law of this name."""
        return _group(find_law(name))


LAWS = Laws()


@functools.cache
def _group(law: Law) -> Group:
    own = {declared.name: spec_of(declared) for declared in declared_keys(Controller)}
    kind: Any = Literal[law.name]
    key = Key(f"Name of the torque law. {law.summary.removesuffix('.')}")
    own["law"] = Spec(key, always(kind), choices=(law.name,))
    names = ", ".join(f"{key} [{gain.unit}]" for key, gain in law.gains.items())
    gains = _gains(law)
    needed = any(spec.required for spec in gains.fields.values())
    key = Key(f"Gains of the law: {names or 'none'}")
    own["gains"] = Spec(key, gains.type, own["name"].default if needed else {}, gains)
    for name, option in law.options.items():
        choices: tuple[Any, ...] = option.values
        own[name] = Spec(Key(option.meaning, end=""), always(option_type(choices)), choices[0], choices=choices)
    for rules in law.rules.values():
        only = "" if rules.only_with is None else f"; only with {rules.condition}"
        text = f"{rules.meaning}: a name under the top level's fuzzy, or {', '.join(BUILTIN)}{only}"
        own["fuzzy"] = Spec(Key(text), always(str), rules.default)

    def make(values: dict[str, Any]) -> Controller:
        options = {key: value for key, value in values.items() if key not in RESERVED}
        fuzzy = values.get("fuzzy") if law.fuzzy_problem(options) is None else None
        return Controller(values["name"], law.name, options, values["gains"] or {}, values["expect"], fuzzy)

    return Group(law.name, law.summary, own, make, noun="key or option")


def _gains(law: Law) -> Group:
    def make(values: dict[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in values.items() if value is not None}

    fields = {name: _gain(gain) for name, gain in law.gains.items()}
    return Group(f"{law.name} gains", f"Gains of the law {law.name}.", fields, make, noun="gain")


def _gain(gain: Gain) -> Spec:
    note = "" if gain.only_with is None else f"; only with {gain.condition}"
    above, at_least = (0, None) if gain.positive else (None, 0)
    key = Key(gain.meaning, gain.unit, note, above, at_least, end="")
    default = MISSING if gain.only_with is None else None
    return Spec(key, always(Annotated[Any, NumberOrList(key)]), default, vector=True)
