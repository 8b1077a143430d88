"""A controller in a config: its own keys, and those that its law declares."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import MISSING, dataclass
from typing import Annotated, Any, Literal

import torquebench.laws  # noqa: F401  (registers the built-in laws)
from torquebench.experiment.extends import AUTO, FROM, without
from torquebench.experiment.groups import Group, Many, OneOf, declare
from torquebench.experiment.values import Here, Slug, Value, Word, vector
from torquebench.experiment.yaml_tree import BROKEN
from torquebench.fuzzy import BUILTIN
from torquebench.keys import Declared, Key, Vector, declared_keys
from torquebench.laws.declare import RESERVED, Gain
from torquebench.laws.law import LAWS, Law, find_law, law_names

MAX_CONTROLLERS = 64


@dataclass(frozen=True)
class Controller:
    """One controller: a law, the choices that set its form, and its gains."""

    name: Annotated[
        Slug,
        Key("Name of the controller, unique in the file; also of its folder, so not figures; if left out, its law's"),
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
        super().__init__(LAWS, "Name of the torque law.", tag="law")
        self._only = None if only is None else tuple(sorted(only))

    def names(self) -> tuple[str, ...]:
        """Names of the registered laws, or of those that were chosen."""
        return law_names() if self._only is None else self._only

    def group(self, name: str) -> Group:
        """Return the keys of a controller with a law of this name."""
        return _group(find_law(name))


def controllers(only: Iterable[str] | None = None) -> Many:
    """Return what the section of controllers holds; see `Laws`."""
    return Many("controllers", 1, MAX_CONTROLLERS, Laws(only))


@functools.cache
def _group(law: Law) -> Group:
    fields = {declared.name: declared for declared in declared_keys(Controller)}
    key = Key(f"Name of the torque law. {law.summary.removesuffix('.')}")
    fields["name"] = fields["name"]._replace(default=None)
    fields["law"] = declare("law", key, Word((law.name,)))
    names = ", ".join(f"{key} [{gain.unit}]" for key, gain in law.gains.items())
    gains = [_gain(name, gain) for name, gain in law.gains.items()]
    node = Gains(f"{law.name} gains", f"Gains of the law {law.name}.", gains, _given, noun="gain")
    default: Any = MISSING if any(gain.required for gain in gains) else {}
    fields["gains"] = declare("gains", Key(f"Gains of the law: {names or 'none'}"), node, default)
    for name, option in law.options.items():
        fields[name] = declare(name, Key(option.meaning, end=""), Word(option.values), option.values[0])
    for rules in law.rules.values():
        only = "" if rules.only_with is None else f"; only with {rules.condition}"
        key = Key(f"{rules.meaning}: a name under the top level's fuzzy, or {', '.join(BUILTIN)}{only}")
        fields["fuzzy"] = declare("fuzzy", key, Value(key, str), rules.default)

    def make(values: dict[str, Any]) -> Controller:
        options = {key: value for key, value in values.items() if key not in RESERVED}
        fuzzy = values.get("fuzzy") if law.fuzzy_problem(options) is None else None
        gains = values["gains"]
        if FROM in gains:
            acting = [name for name, gain in law.gains.items() if name in gains or gain.acts(options)]
            gains = {name: gains.get(name, AUTO) for name in acting}
        return Controller(values["name"] or law.name, law.name, options, gains, values["expect"], fuzzy)

    return Group(law.name, law.summary, fields.values(), make, noun="key or option")


class Gains(Group):
    """Gains of a law; of ``{from: auto, ...}`` those that are given, with `FROM` to say that the others are chosen."""

    def read(self, raw: Any, here: Here) -> Any:
        """Return the gains that are given."""
        if not (isinstance(raw, dict) and raw.get(FROM) == AUTO):
            return super().read(raw, here)
        some = Group("", self.doc, [one._replace(default=None) for one in self.fields.values()], _given, self.noun)
        given = some.read(without(raw, FROM), here)  # type: ignore[arg-type]  # every mapping of a document is a Map
        return given if given is BROKEN else {FROM: AUTO, **given}


def _given(gains: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in gains.items() if value is not None}


def _gain(name: str, gain: Gain) -> Declared:
    note = "" if gain.only_with is None else f"; only with {gain.condition}"
    above, at_least = (0, None) if gain.positive else (None, 0)
    key = Key(gain.meaning, gain.unit, note, above, at_least, end="")
    return declare(name, key, vector(key), MISSING if gain.only_with is None else None)
