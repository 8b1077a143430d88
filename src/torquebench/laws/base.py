"""How a law is declared and found: gains, memory, the `@controller` decorator and the registry."""

from __future__ import annotations

import copy
import re
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from torquebench.errors import ControllerError, did_you_mean
from torquebench.fuzzy import BUILTIN, DEFAULT, Fis, FuzzySystem, builtin_system, prepare
from torquebench.kernel import Array

SLUG = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,62}[a-z0-9])?")


def _acts(only_with: tuple[str | bool, ...] | None, chosen: Mapping[str, str | bool]) -> bool:
    return only_with is None or chosen.get(str(only_with[0])) in only_with[1:]


def _condition(only_with: tuple[str | bool, ...] | None) -> str:
    option, *values = only_with or ("",)
    return f"{option}: {' or '.join(str(value).lower() for value in values)}"


class Gain(NamedTuple):
    """What a vector gain means: shown in help, checked when a config is read."""

    meaning: str
    """What the gain does, in words."""
    unit: str
    """SI unit; ``1`` for a pure number."""
    positive: bool = True
    """Whether zero is refused too (negative gains always are)."""
    only_with: tuple[str | bool, ...] | None = None
    """(option, value, ...): the gain has an effect with these values of the option only, and is refused with others."""

    def acts(self, chosen: Mapping[str, str | bool]) -> bool:
        """Whether the gain has an effect under the chosen options."""
        return _acts(self.only_with, chosen)

    @property
    def condition(self) -> str:
        """What `only_with` asks for, as in a config."""
        return _condition(self.only_with)


class Option(NamedTuple):
    """A choice that changes the law's form; the law receives 1 or 0 for a boolean, else the value's index."""

    meaning: str
    """What is chosen, in words."""
    values: tuple[str | bool, ...]
    """Accepted values; the first is the default."""


class Rules(NamedTuple):
    """The law's fuzzy system: a field of type `Fis`, at most one; a config chooses the system by name."""

    meaning: str
    """What its output does, in words."""
    inputs: Callable[[Any, int, float, float], tuple[float, float]] | None = None
    """Kernel (gains, joint, e, de) -> the system's two normalised inputs, by which the law scales them. Figures use it
    to tell which rules fired; without it they do not."""
    default: str = DEFAULT
    """Built-in system that the law has where a config names none."""
    only_with: tuple[str | bool, ...] | None = None
    """As of a gain: the system has an effect with these values of the option only, and is refused with others."""

    def acts(self, chosen: Mapping[str, str | bool]) -> bool:
        """Whether the system has an effect under the chosen options."""
        return _acts(self.only_with, chosen)

    @property
    def condition(self) -> str:
        """What `only_with` asks for, as in a config."""
        return _condition(self.only_with)


class FixedRules(NamedTuple):
    """Another fuzzy system of the law, a field of type `Fis` that a config does not choose; any number of them."""

    meaning: str
    """What its output does, in words."""
    system: str
    """Name of the built-in system."""


@dataclass(frozen=True, slots=True, eq=False)
class Law:
    """A registered torque law.

    `function(gains, model, t, q, qd, ref, memory, tau)` fills `tau` (n,) [N m] in place; `memory` is its only
    state and starts at zero. `gains` and `memory` are NamedTuples of (n,) arrays; options in `gains` are integers
    (see `Option`), and a fuzzy system in it is a `Fis` (see `Rules`).
    """

    name: str
    function: Callable[..., None]
    gains_type: type[Any]
    memory_type: type[Any] | None
    gains: Mapping[str, Gain]
    options: Mapping[str, Option]
    rules: Mapping[str, Rules] = field(default_factory=dict)
    fixed: Mapping[str, FixedRules] = field(default_factory=dict)

    @property
    def summary(self) -> str:
        """First line of the law's docstring."""
        return (self.function.__doc__ or "").strip().partition("\n")[0]

    def new_memory(self, n: int) -> Any:
        """Return the law's memory for `n` joints, all zero."""
        fields = () if self.memory_type is None else self.memory_type._fields
        cls = Nothing if self.memory_type is None else self.memory_type
        return cls(*(np.zeros(n) for _ in fields)) if fields else cls(np.zeros(0))

    def pack_gains(
        self,
        n: int,
        values: Mapping[str, Any],
        options: Mapping[str, str | bool],
        fuzzy: FuzzySystem | str | None = None,
    ) -> Any:
        """Return the gains tuple the law receives.

        Args:
            n: Number of joints; scalars are repeated for each.
            values: Gain name -> scalar or (n,) sequence, finite and not negative.
            options: Option name -> one of its values; missing options take their first value.
            fuzzy: Fuzzy system, or the name of a built-in one, of a law that has one; None for the default.

        Raises:
            ControllerError: a gain is unknown, missing, without effect, of wrong length, or out of range; or the
                fuzzy system is unknown or the law has none.
        """
        chosen = {name: options.get(name, option.values[0]) for name, option in self.options.items()}
        problems = [f"unknown option '{k}'{did_you_mean(k, self.options)}" for k in options if k not in self.options]
        problems += [f"unknown gain '{k}'{did_you_mean(k, self.gains)}" for k in values if k not in self.gains]
        packed: dict[str, Any] = {}
        for name, option in self.options.items():
            value = chosen[name]
            if any(type(value) is type(valid) and value == valid for valid in option.values):  # 1 == True
                packed[name] = int(value) if isinstance(value, bool) else option.values.index(value)
            else:
                problems.append(f"option '{name}' is {chosen[name]!r}, wanted one of {option.values}")
        for name, gain in self.gains.items():
            problem = self.gain_problem(name, name in values, chosen)
            if problem:
                problems.append(problem)
            elif name in values:
                array = _numbers(values[name])
                if array is None:
                    problems.append(f"gain '{name}' is {values[name]!r}, wanted a number or {n} numbers")
                elif array.shape not in ((), (n,)):
                    problems.append(f"gain '{name}' has shape {array.shape}, wanted a number or {n} numbers")
                elif not np.all(np.isfinite(array)) or np.any(array < 0) or (gain.positive and np.any(array == 0)):
                    low = "positive" if gain.positive else "zero or positive"
                    problems.append(f"gain '{name}' is {values[name]!r}, wanted finite and {low} [{gain.unit}]")
                else:
                    packed[name] = np.array(np.broadcast_to(array, (n,)))
            else:
                packed[name] = np.ones(n)  # without effect under these options; never read by the law
        systems = {name: builtin_system(own.system) for name, own in self.fixed.items()}
        for name, rules in self.rules.items():
            systems[name] = fuzzy if isinstance(fuzzy, FuzzySystem) else builtin_system(fuzzy or rules.default)
        packed |= {name: copy.deepcopy(prepare(system).fis) for name, system in systems.items()}  # the law may write
        if not self.rules and fuzzy is not None:
            problems.append("it has no fuzzy system to choose")
        if fuzzy is not None and (problem := self.fuzzy_problem(chosen)):
            problems.append(problem)
        if problems:
            raise ControllerError(f"law '{self.name}': " + "; ".join(problems))
        return self.gains_type(**packed)

    def gain_problem(self, name: str, given: bool, chosen: Mapping[str, str | bool]) -> str | None:
        """Return why a gain may not be given or left out under the chosen options, or None."""
        gain = self.gains[name]
        if not gain.acts(chosen):
            return f"gain '{name}' has no effect unless {gain.condition}" if given else None
        return None if given else f"gain '{name}' is missing ({gain.meaning} [{gain.unit}])"

    def fuzzy_problem(self, chosen: Mapping[str, str | bool]) -> str | None:
        """Return why no fuzzy system may be chosen under the chosen options, or None."""
        idle = next((rules for rules in self.rules.values() if not rules.acts(chosen)), None)
        return None if idle is None else f"its fuzzy system has no effect unless {idle.condition}"


def _numbers(value: Any) -> Array | None:
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        return None


class Nothing(NamedTuple):
    """Memory of a law that needs none."""

    nothing: Array


_REGISTRY: dict[str, Law] = {}
RESERVED = ("name", "law", "fuzzy", "gains", "expect")
"""Keys of a controller in a config, which an option would collide with."""


def controller(
    name: str, *, gains: type[Any], memory: type[Any] | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a law under `name`.

    Args:
        name: Slug by which configs call the law.
        gains: NamedTuple class; array fields are gains (annotate with `Gain`), integer fields are options
            (annotate with `Option`), a field of type `Fis` is the law's fuzzy system (annotate with `Rules`, and any
            others with `FixedRules`).
        memory: NamedTuple class of (n,) arrays kept between control instants; a field called `s` is recorded as
            the sliding variable.

    Raises:
        ControllerError: the name is taken or is not a slug, a field is not a gain, an option or a fuzzy system, or a
            gain depends on a choice that the law does not have.
    """
    if not SLUG.fullmatch(name):
        raise ControllerError(f"law name '{name}' is not a slug (lower-case letters, digits and '-', at most 64)")

    def register(function: Callable[..., None]) -> Callable[..., None]:
        if name in _REGISTRY and not _same_place(_REGISTRY[name].function, function):
            raise ControllerError(f"a law named '{name}' is already registered")
        vectors, choices, systems, fixed = _fields(name, gains)
        _check_conditions(name, {**vectors, **systems}, choices)
        _REGISTRY[name] = Law(name, function, gains, memory, vectors, choices, systems, fixed)
        return function

    return register


def _same_place(old: Callable[..., None], new: Callable[..., None]) -> bool:
    """Whether a function replaces itself, as when a notebook's cell runs again."""
    return (old.__module__, old.__qualname__) == (new.__module__, new.__qualname__) and old.__module__ == "__main__"


def _fields(
    law: str, gains: type[Any]
) -> tuple[Mapping[str, Gain], Mapping[str, Option], Mapping[str, Rules], Mapping[str, FixedRules]]:
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


def _check_conditions(law: str, declared: Mapping[str, Gain | Rules], choices: Mapping[str, Option]) -> None:
    """Refuse a gain or system that depends on what no option of the law can be: it could never be given."""
    for name, note in declared.items():
        if note.only_with is None:
            continue
        what = f"law '{law}': {'gain' if isinstance(note, Gain) else 'fuzzy system'} '{name}' depends on"
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


def find_law(name: str) -> Law:
    """Return the registered law called `name`.

    Raises:
        ControllerError: there is none; the message names the nearest one.
    """
    if name not in _REGISTRY:
        raise ControllerError(f"unknown law '{name}'{did_you_mean(name, sorted(_REGISTRY))}")
    return _REGISTRY[name]


def law_names() -> tuple[str, ...]:
    """Names of all registered laws, sorted."""
    return tuple(sorted(_REGISTRY))
