"""Declaring a law's gains, options and fuzzy systems: annotations on the fields of its gains class."""

from __future__ import annotations

import math
import types
from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

from torquebench.errors import ControllerError, did_you_mean
from torquebench.fuzzy import BUILTIN, DEFAULT, Fis
from torquebench.tuning import BY_UNIT, Rule, Search

RESERVED = ("name", "law", "fuzzy", "gains", "expect")
"""Keys of a controller in a config, which an option would collide with."""


def _acts(only_with: tuple[str | bool, ...] | None, chosen: Mapping[str, str | bool]) -> bool:
    return only_with is None or chosen.get(str(only_with[0])) in only_with[1:]


def _condition(only_with: tuple[str | bool, ...] | None) -> str:
    option, *values = only_with or ("",)
    return f"{option}: {' or '.join(str(value).lower() for value in values)}"


class Gain(NamedTuple):
    """Meaning, unit and range of a vector gain: shown in help, checked when a config is read."""

    meaning: str
    """Effect of the gain, in words."""
    unit: str
    """SI unit; ``1`` for a pure number."""
    positive: bool = True
    """Refuse zero too; negative gains are always refused."""
    only_with: tuple[str | bool, ...] | None = None
    """(option, value, ...): the gain has an effect with these values of the option only, and is refused with others."""
    auto: Rule | None = None
    """How ``gains: auto`` chooses it; None for the rule of its unit."""
    search: Search | None = None
    """(low, high, spacing): where tuning looks for it, one number for all joints in its own unit; None for the box of
    its unit, see `BOXES`."""

    @property
    def rule(self) -> Rule | None:
        """The rule by which it is chosen; None where there is none for its unit."""
        return self.auto or BY_UNIT.get(self.unit)

    def acts(self, chosen: Mapping[str, str | bool]) -> bool:
        """True if the gain has an effect under the chosen options."""
        return _acts(self.only_with, chosen)

    @property
    def condition(self) -> str:
        """The condition of `only_with`, as written in a config."""
        return _condition(self.only_with)


class Option(NamedTuple):
    """A choice that changes the law's form; the law receives 1 or 0 for a boolean, else the value's index."""

    meaning: str
    """The choice, in words."""
    values: tuple[str | bool, ...]
    """Accepted values; the first is the default."""


class Rules(NamedTuple):
    """The law's fuzzy system: a field of type `Fis`, at most one; a config chooses the system by name."""

    meaning: str
    """Effect of its output, in words."""
    inputs: Callable[[Any, int, float, float], tuple[float, float]] | None = None
    """Kernel (gains, joint, e, de) -> the system's two normalised inputs, by which the law scales them. Figures use it
    to tell which rules fired; without it they do not."""
    default: str = DEFAULT
    """Built-in system that the law has where a config names none."""
    only_with: tuple[str | bool, ...] | None = None
    """As for a gain: the system has an effect with these values of the option only, and is refused with others."""

    def acts(self, chosen: Mapping[str, str | bool]) -> bool:
        """True if the system has an effect under the chosen options."""
        return _acts(self.only_with, chosen)

    @property
    def condition(self) -> str:
        """The condition of `only_with`, as written in a config."""
        return _condition(self.only_with)


class FixedRules(NamedTuple):
    """Another fuzzy system of the law, a field of type `Fis` that a config does not choose; any number of them."""

    meaning: str
    """Effect of its output, in words."""
    system: str
    """Name of the built-in system."""


def declared_fields(
    law: str, gains: type[Any]
) -> tuple[Mapping[str, Gain], Mapping[str, Option], Mapping[str, Rules], Mapping[str, FixedRules]]:
    """Return what the fields of a law's gains declare, each kind by name.

    Raises:
        ControllerError: a field is none of them, or a law has two fuzzy systems or one that is not built in.
    """
    vectors: dict[str, Gain] = {}
    choices: dict[str, Option] = {}
    systems: dict[str, Rules] = {}
    fixed: dict[str, FixedRules] = {}
    for name, hint in get_type_hints(gains, include_extras=True).items():
        notes = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
        note = next((x for x in notes if isinstance(x, Gain | Option | Rules | FixedRules)), None)
        plain = get_args(hint)[0] if notes else hint
        if isinstance(note, Option):
            if name in RESERVED:
                raise ControllerError(f"law '{law}': no option may be called '{name}': configs use that key")
            choices[name] = note
        elif isinstance(note, Gain):
            _check_search(law, name, note)
            vectors[name] = note
        elif isinstance(note, Rules):
            if systems:
                raise ControllerError(f"law '{law}': has two fuzzy systems, '{next(iter(systems))}' and '{name}'")
            _check_built_in(law, name, note.default)
            systems[name] = note
        elif isinstance(note, FixedRules):
            _check_built_in(law, name, note.system)
            fixed[name] = note
        elif plain is Fis:
            raise ControllerError(f"law '{law}': fuzzy system '{name}' needs Annotated[Fis, Rules(...)]")
        elif plain is int or plain is bool:
            raise ControllerError(f"law '{law}': option '{name}' needs Annotated[int, Option(...)] to list its values")
        else:
            vectors[name] = Gain("gain of a user's law", "not stated", positive=False)
    proxy = types.MappingProxyType
    return proxy(vectors), proxy(choices), proxy(systems), proxy(fixed)


def _check_built_in(law: str, field_name: str, system: str) -> None:
    if system not in BUILTIN:
        raise ControllerError(
            f"law '{law}': '{field_name}' names '{system}', which is not built in{did_you_mean(system, BUILTIN)}"
        )


def _check_search(law: str, name: str, gain: Gain) -> None:
    if gain.search is None:
        return
    given: Any = gain.search
    least = "more than 0" if gain.positive or given[-1:] == ("log",) else "at least 0"
    match given:
        case (int() | float() as low, int() | float() as high, "log" | "linear") if low < high < math.inf and (
            low > 0.0 or (low == 0.0 and least == "at least 0")
        ):
            return
    wanted = f"(low, high, 'log' or 'linear') in {gain.unit}, low {least} and less than high"
    raise ControllerError(f"law '{law}': search of gain '{name}' is {given!r}, wanted {wanted}")


def check_conditions(law: str, declared: Mapping[str, Gain | Rules], choices: Mapping[str, Option]) -> None:
    """Refuse a gain or system that depends on what no option of the law can be: it could never be given."""
    for name, note in declared.items():
        if note.only_with is None:
            continue
        kind = "" if name == "has_model" else "gain " if isinstance(note, Gain) else "fuzzy system "
        what = f"law '{law}': {kind}'{name}' depends on"
        option, *values = note.only_with
        if option not in choices:
            raise ControllerError(f"{what} option '{option}'{did_you_mean(str(option), choices)}")
        valid = choices[str(option)].values
        for value in values:
            if not any(type(value) is type(x) and value == x for x in valid):
                near = did_you_mean(value, [str(x) for x in valid])
                raise ControllerError(f"{what} {option}: {value!r}{near}")
        if not values:
            raise ControllerError(f"{what} option '{option}', but on no value of it")
