"""Torque laws: how one is registered, found, and given its gains and memory."""

from __future__ import annotations

import copy
import inspect
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from torquebench.chain import IDEAL, Chain
from torquebench.errors import ControllerError, did_you_mean
from torquebench.fuzzy import FuzzySystem, builtin_system, prepare
from torquebench.kernel import Array
from torquebench.keys import as_vector
from torquebench.laws.declare import FixedRules, Gain, Option, Rules, check_conditions, declared_fields
from torquebench.registry import Registry, docstring
from torquebench.robot.dynamics import bias_forces, gravity, inverse_dynamics, mass_matrix
from torquebench.robot.robot_model import RobotModel
from torquebench.tuning import Fit, choose, limits_of


class Nothing(NamedTuple):
    """Memory of a law that needs none."""

    nothing: Array


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
    rigid_only: bool = False
    """Whether its model must have structure `exact`: it computes with links, which the closed forms do not."""
    declared_model: HasModel = None
    """What `has_model` of `controller` says."""

    @property
    def summary(self) -> str:
        """First line of the law's docstring."""
        return docstring(self.function).partition("\n")[0]

    @property
    def ships(self) -> bool:
        """Whether it is one of the package's own laws."""
        return str(getattr(self.function, "__module__", "")).startswith("torquebench.laws.")

    @property
    def terms(self) -> frozenset[str]:
        """Terms of the arm's dynamics that its source calls, with some of its options at least."""
        return frozenset(terms_called(self.function))

    def has_model(self, options: Mapping[str, str | bool]) -> bool:
        """Return whether the law cancels the arm's dynamics with its model, for `choose_gains`.

        What `controller` was told; else what the option ``equivalent_control`` says where the law has it, else
        whether its source calls `inverse_dynamics`, or `mass_matrix` and one of `bias_forces` and `gravity`.

        Args:
            options: Option name -> value; those left out take their defaults.
        """
        if isinstance(self.declared_model, bool):
            return self.declared_model
        chosen = {name: options.get(name, option.values[0]) for name, option in self.options.items()}
        if self.declared_model is not None:
            option, *values = self.declared_model
            return chosen[str(option)] in values
        if "equivalent_control" in chosen:
            return bool(chosen["equivalent_control"])
        called = self.terms
        return "inverse_dynamics" in called or ("mass_matrix" in called and len(called) > 1)

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
                elif not _in_range(array.ravel().tolist(), gain.positive):
                    low = "positive" if gain.positive else "zero or positive"
                    problems.append(f"gain '{name}' is {values[name]!r}, wanted finite and {low} [{gain.unit}]")
                else:
                    packed[name] = np.full(n, array)
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

    def choose_gains(
        self,
        model: RobotModel,
        control_period: float = 0.001,
        chain: Chain = IDEAL,
        options: Mapping[str, str | bool] | None = None,
        given: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Return gains that suit an arm, those that are given among them, as ``gains: auto`` does; see `Gain.auto`.

        Args:
            model: The arm.
            control_period: Time between control instants [s].
            chain: Sensors and actuators.
            options: Option name -> value; those left out take their defaults.
            given: Gains that are chosen already; the others follow from them.

        Returns:
            Name of each gain that acts -> one number where all joints have the same, else one for each.

        Raises:
            ControllerError: a gain that is not given has no rule.
        """
        given = dict(given or {})
        found = {**choose(self.fit(model, control_period, chain, options, given)), **given}
        return {name: found[name] for name in self.gains if name in found}

    def fit(
        self,
        model: RobotModel,
        control_period: float,
        chain: Chain,
        options: Mapping[str, str | bool] | None,
        given: Mapping[str, Any],
    ) -> Fit:
        """Return the law on an arm as the rules of its gains see it.

        Args:
            model, control_period, chain, options, given: As of `choose_gains`.

        Raises:
            ControllerError: a gain that acts has neither a value nor a rule.
        """
        chosen = {name: option.values[0] for name, option in self.options.items()} | dict(options or {})
        acting = {name: gain for name, gain in self.gains.items() if name in given or gain.acts(chosen)}
        problems = [text for name in acting if name not in given and (text := self.no_rule(name))]
        if problems:
            raise ControllerError(f"law '{self.name}': " + "; ".join(problems))
        rules = {name: gain.rule for name, gain in acting.items() if gain.rule is not None}
        known = {name: np.full(model.n, value, dtype=np.float64) for name, value in given.items()}
        reaction = chain.reaction(control_period)
        gain = np.array(as_vector(chain.torque_gain, model.n))
        drives = np.where(gain > 0.0, gain, 1.0)  # of a drive that gives nothing any gain will do
        limits = limits_of(model).behind(drives)
        return Fit(limits, reaction, control_period, rules, self.has_model(chosen), drives, known)

    def misfit(self, structure: str) -> str:
        """Return why the law cannot have a model of this structure; nothing where it can."""
        if not self.rigid_only or structure == "exact":
            return ""
        return f"law '{self.name}' computes with the links of a rigid body, which structure {structure} does not have"

    def no_rule(self, name: str) -> str:
        """Return why a gain cannot be chosen; nothing where it can."""
        gain = self.gains[name]
        return "" if gain.rule else f"gain '{name}' [{gain.unit}] has no rule by which it could be chosen"

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


HasModel = bool | tuple[str | bool, ...] | None
"""Whether a law cancels the arm's dynamics: always or never; with (option, value, ...); None for what it calls."""
_TERMS = {
    getattr(term, "py_func", term): term.__name__ for term in (mass_matrix, gravity, bias_forces, inverse_dynamics)
}


def terms_called(function: Any) -> set[str]:
    """Return the terms of the dynamics that a function's source names, itself or in functions that it names.

    A law that runs in a process of its own has had that process look: they are its ``terms``.

    Args:
        function: A law or a kernel.
    """
    return {_TERMS[own] for own in functions_named(function) if own in _TERMS} | set(getattr(function, "terms", ()))


def functions_named(function: Any, seen: set[FunctionType] | None = None) -> Iterator[FunctionType]:
    """Yield the functions that a function's source names, itself or in functions that it names, each once.

    Terms of the dynamics are not looked into.

    Args:
        function: A law or a kernel.
        seen: Those that were named already; changed.
    """
    function, seen = getattr(function, "py_func", function), set() if seen is None else seen
    if not isinstance(function, FunctionType) or function in _TERMS:
        return
    scope, names = inspect.getclosurevars(function), function.__code__.co_names
    used = [*scope.globals.values(), *scope.nonlocals.values()]
    used += [getattr(x, name, None) for x in used if isinstance(x, ModuleType) for name in names]
    for value in used:
        own = getattr(value, "py_func", value)
        if isinstance(own, FunctionType) and own not in seen:
            seen.add(own)
            yield own
            yield from functions_named(own, seen)


def _numbers(value: Any) -> Array | None:
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        return None


def _in_range(numbers: list[float], positive: bool) -> bool:
    least = min(numbers)
    return all(map(math.isfinite, numbers)) and (least > 0.0 or (least == 0.0 and not positive))


LAWS: Registry[Law] = Registry("law", error=ControllerError)
"""Every registered law."""


def controller(
    name: str,
    *,
    gains: type[Any],
    memory: type[Any] | None = None,
    rigid_only: bool = False,
    has_model: HasModel = None,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a law under `name`.

    Args:
        name: Slug by which configs call the law.
        gains: NamedTuple class; array fields are gains (annotate with `Gain`), integer fields are options
            (annotate with `Option`), a field of type `Fis` is the law's fuzzy system (annotate with `Rules`, and any
            others with `FixedRules`).
        memory: NamedTuple class of (n,) arrays kept between control instants; a field called `s` is recorded as
            the sliding variable.
        rigid_only: Whether the law computes with the links of its model, so that a model of the paper's closed forms
            is refused before a run.
        has_model: Whether the law cancels the arm's dynamics with its model, which ``gains: auto`` counts on;
            (option, value, ...) where a choice decides. Without it what the source calls decides; see `Law.has_model`.

    Raises:
        ControllerError: the name is taken or is not a slug, a field is not a gain, an option or a fuzzy system, or a
            gain or `has_model` depends on a choice that the law does not have.
    """

    def register(function: Callable[..., None]) -> Callable[..., None]:
        vectors, choices, systems, fixed = declared_fields(name, gains)
        conditions = {"has_model": Gain("", "1", only_with=has_model)} if isinstance(has_model, tuple) else {}
        check_conditions(name, {**vectors, **systems, **conditions}, choices)
        law = Law(name, function, gains, memory, vectors, choices, systems, fixed, rigid_only, has_model)
        LAWS.register(name, law, function)
        return function

    return register


def find_law(name: str) -> Law:
    """Return the registered law called `name`.

    Raises:
        ControllerError: there is none; the message names the nearest one.
    """
    return LAWS.find(name)


def law_names() -> tuple[str, ...]:
    """Names of all registered laws, sorted."""
    return tuple(sorted(LAWS))
