"""Fuzzy systems in a config: every key with its type and meaning, and what makes a system of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, Union

from pydantic import Field

from torquebench.errors import Fault, FuzzyError
from torquebench.experiment.groups import Group, Many, Named, OneOf, group_of
from torquebench.experiment.values import Here, Node, Value, number, one_or_some, some
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import BROKEN, KeyPath
from torquebench.fuzzy import Functions, FuzzySystem, Rule, Variable
from torquebench.fuzzy.system import rules_of_table
from torquebench.fuzzy.terms import MAX_TERMS, NONE, SHAPES, Shape, range_error, shape_errors
from torquebench.keys import Key, Kinds

MAX_SYSTEMS = 64
MAX_RULES = 2 * MAX_TERMS * MAX_TERMS
RULES = "rules"
SHAPE = "one number (a peak), 3 numbers (a triangle), 4 (a trapezoid), or a curve such as {kind: gaussian, ...}"
FUNCTION = "one number, or a list of a constant and a factor of each input"
RULE_FORMS = "rows of consequents, one row of them for one input, or rules {if: [...], then: ...}"

SYSTEMS = Kinds("kind of fuzzy system")


def _numbers(key: Key, least: int, most: int) -> Value:
    """Return the node of one number, or a list of some."""
    one = number(key)
    return Value(key, one_or_some(one, some(one, least, most)))


class ShapeForms(Node):
    """The shape of a term: one number, some numbers, or a curve.

    Args:
        key: What it means.
    """

    def __init__(self, key: Key) -> None:
        self._numbers = _numbers(key, 3, 4)
        self._curve = OneOf(SHAPES, "Curve of the degree.", closed=True)
        self.wanted = key.wanted

    def groups(self) -> Iterable[Group]:
        """Return the groups of keys of the curves."""
        return self._curve.groups()

    def read(self, raw: Any, here: Here) -> Any:
        """Return the shape."""
        return (self._curve if isinstance(raw, dict) else self._numbers).read(raw, here)

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return Union[self._numbers.type(), self._curve.type()]  # noqa: UP007  (computed types)


def _shapes(key: Key, item: Node) -> Named:
    """Return the node of a mapping of names to shapes or functions."""
    return Named(f"a mapping of names to {key.wanted}", item)


_RANGE = Key("What the law sees as -1 and 1", wanted="a list of two numbers, such as [-1, 1]")
_FUNCTIONS = Key(
    "Name and function: a constant, or a constant and a factor of each input in its own units", "1", wanted=FUNCTION
)
_TERMS = Key("Name and shape, as of an input", "1", wanted=SHAPE)
_OVERLAPPING = Key(
    "Name and shape, from low to high: a number is the peak of a triangle that reaches to the peaks beside it; "
    "3 numbers are a triangle, 4 a trapezoid; a mapping is a curve",
    "1",
    wanted=SHAPE,
)
FunctionNumbers: TypeAlias = Mapping[str, float | tuple[float, ...]]
Shapes: TypeAlias = Mapping[str, Shape]


@dataclass(frozen=True, kw_only=True)
class FuzzyFunctions:
    """The output of a Sugeno system: named functions of the inputs."""

    range: Annotated[tuple[float, float], _RANGE] = (-1.0, 1.0)
    functions: Annotated[FunctionNumbers, _FUNCTIONS, _shapes(_FUNCTIONS, _numbers(_FUNCTIONS, 1, 3))]


@dataclass(frozen=True, kw_only=True)
class FuzzyTerms:
    """The output of a Mamdani system: named terms, which may reach beyond the range."""

    range: Annotated[tuple[float, float], _RANGE] = (-1.0, 1.0)
    terms: Annotated[Shapes, _TERMS, _shapes(_TERMS, ShapeForms(_TERMS))]


@dataclass(frozen=True, kw_only=True)
class FuzzyInput(FuzzyTerms):
    """A range, to which the input is clipped, and named terms that overlap on it."""

    terms: Annotated[Shapes, _OVERLAPPING, _shapes(_OVERLAPPING, ShapeForms(_OVERLAPPING))]


def _variable_faults(path: KeyPath, keys: FuzzyTerms | FuzzyFunctions) -> Iterator[Fault]:
    """Yield what is wrong with an input or the output, which stands at a path."""
    message = range_error(*keys.range)
    if message is not None:
        yield Fault((*path, "range"), message)
    for finding in shape_errors(keys.terms) if isinstance(keys, FuzzyTerms) else ():
        yield Fault((*path, *finding.where), finding.message)


_WORDS: Any = some(str, 1)
_WHEN = Key(
    "A term of each input, of which all must hold; any, or fewer terms, for an input left open; [A, or, B] where one "
    "is enough",
    name="if",
    wanted="names of one or two terms, with or between them where one is enough",
)
OR = "or"


@dataclass(frozen=True)
class FuzzyRule:
    """One rule, where rules are not a table."""

    when: Annotated[str | tuple[str, ...], _WHEN, Value(_WHEN, one_or_some(str, some(str, 1, 3)))]
    then: Annotated[str, Key("Name of the consequent")]

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong with three words."""
        if isinstance(self.when, tuple) and len(self.when) == 3 and self.when[1] != OR:
            yield Fault(("if",), got=f"3 names, {shown(self.when[1])} in the middle", wanted=_WHEN.wanted)

    @property
    def rule(self) -> Rule:
        """The rule."""
        when = (self.when,) if isinstance(self.when, str) else self.when
        return Rule((when[0], when[2]), self.then, either=True) if len(when) == 3 else Rule(when, self.then)


class RuleForms(Node):
    """Rules, all of one form: rows of consequents, one row of them, or rules one by one."""

    wanted = f"a list: {RULE_FORMS}"

    def __init__(self) -> None:
        each = Many("rules", 1, MAX_RULES, group_of(FuzzyRule))
        self._forms: Mapping[type, Node] = {
            str: Value(Key(""), _WORDS),
            list: Value(Key(""), some(_WORDS, 1)),
            dict: each,
        }

    def read(self, raw: Any, here: Here) -> Any:
        """Return the rules, a tuple."""
        if not isinstance(raw, list) or not 1 <= len(raw) <= MAX_RULES:
            here.add(got=shown(raw), wanted=self.wanted)
            return BROKEN
        form = next((form for form in self._forms if isinstance(raw[0], form)), None)
        if form is None:
            if raw[0] is not BROKEN:
                here.add(below=(0,), got=shown(raw[0]), wanted=RULE_FORMS)
            return BROKEN
        like = f"{shown(raw[0])} like the first: {RULE_FORMS}"
        odd = [(i, item) for i, item in enumerate(raw) if not isinstance(item, form) and item is not BROKEN]
        if odd and form is not str:
            for i, item in odd:
                here.add(below=(i,), got=shown(item), wanted=like)
            return BROKEN
        return self._forms[form].read(raw, here)

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        row = Annotated[list[str], Field(min_length=1, max_length=MAX_TERMS)]
        kinds: Any = str | row | group_of(FuzzyRule).type()
        return Annotated[list[kinds], Field(min_length=1, max_length=MAX_RULES)]


@dataclass(frozen=True, kw_only=True)
class AnyFuzzy:
    """Keys that every fuzzy system has."""

    kind: ClassVar[str]
    inputs: Annotated[
        tuple[FuzzyInput, ...],
        Key("One or two inputs, in the order in which the law gives them"),
        Many("inputs", 1, 2, group_of(FuzzyInput), "a list of one or two inputs"),
    ]
    rules: Annotated[
        tuple[Any, ...],
        Key(
            "A table of consequents, a row for each term of input 1 with a column for each of input 2 (for one input a "
            "single row), none where there is no rule; or a list of rules"
        ),
        RuleForms(),
    ]
    conjunction: Annotated[
        Literal["min", "product"], Key("AND of two inputs; OR is its dual, the maximum or a + b - a b")
    ] = "min"
    output: Any

    def faults(self) -> Iterator[Fault]:
        """Yield what leaves the system without meaning: shapes, then the size of its table, then its rules."""
        variables = [*((("inputs", i), keys) for i, keys in enumerate(self.inputs)), (("output",), self.output)]
        inner = [fault for path, keys in variables for fault in _variable_faults(path, keys)]
        sizes = inner or list(self._sizes())
        yield from sizes or self._meaning()

    def _meaning(self) -> Iterator[Fault]:
        try:
            fuzzy_system("", self)
        except FuzzyError as error:
            places = places_of_rules(self)
            for finding in error.findings:
                first, *rest = finding.where
                where = places[int(rest[0])] if first == RULES and rest else finding.where
                yield Fault(where, finding.message)

    def _sizes(self) -> Iterator[Fault]:
        """Yield a fault where a table of rules has not the size that the inputs' terms ask for."""
        first, *second = [list(variable.terms) for variable in self.inputs]
        rows = self.rules
        if not isinstance(rows[0], str | tuple):
            return
        if isinstance(rows[0], str) == bool(second):
            wanted = "a row of consequents for each term of input 1" if second else "one row of consequents"
            wanted += f", as the inputs are {1 + len(second)}"
            yield Fault((RULES,), got=shown(list(rows)), wanted=wanted)
            return
        yield from _counts((RULES,), len(rows), "rows" if second else "consequents", first, 1)
        for i, row in enumerate(rows):
            if second and isinstance(row, tuple):
                yield from _counts((RULES, i), len(row), "consequents", second[0], 2)


def _counts(path: KeyPath, got: int, what: str, terms: list[str], number: int) -> Iterator[Fault]:
    if got != len(terms):
        one_each = f"one for each term of input {number} ({', '.join(terms)})"
        yield Fault(path, got=f"{got} {what}", wanted=f"{len(terms)}, {one_each}")


@SYSTEMS("mamdani")
@dataclass(frozen=True, kw_only=True)
class MamdaniSystem(AnyFuzzy):
    """Consequents are terms of the output; the output is the centre of what the rules leave of them."""

    output: Annotated[FuzzyTerms, Key("The output's range and terms")]
    aggregation: Annotated[
        Literal[
            "max-min",
            "sum-min",
            "max-bounded-product",
            "max-drastic-product",
            "max-bounded-sum",
            "max-algebraic-sum",
            "min-max",
        ],
        Key("How the rules' consequents become one set"),
    ] = "max-min"
    defuzzification: Annotated[
        Literal["coa", "cog"], Key("Centre of the aggregated set (coa), or of all rules' sets added up (cog)")
    ] = "coa"


@SYSTEMS("sugeno")
@dataclass(frozen=True, kw_only=True)
class SugenoSystem(AnyFuzzy):
    """Consequents are functions of the inputs; the output is their mean, weighted by how much each rule fires."""

    output: Annotated[FuzzyFunctions, Key("The output's range and functions")]


FuzzyKeys: TypeAlias = MamdaniSystem | SugenoSystem


def fuzzy_system(name: str, keys: Any) -> FuzzySystem:
    """Return the system that a config's keys describe.

    Raises:
        FuzzyError: it has no meaning.
    """
    inputs = tuple(Variable.of(variable.terms, *variable.range) for variable in keys.inputs)
    rules = _rules(keys)
    if isinstance(keys, SugenoSystem):
        functions = Functions.of(keys.output.functions, *keys.output.range)
        return FuzzySystem(name, inputs, functions, rules, keys.conjunction)
    output = Variable.of(keys.output.terms, *keys.output.range)
    return FuzzySystem(name, inputs, output, rules, keys.conjunction, keys.aggregation, keys.defuzzification)


def _rules(keys: AnyFuzzy) -> tuple[Rule, ...]:
    rules = keys.rules
    if isinstance(rules[0], str | tuple):
        names = [tuple(variable.terms) for variable in keys.inputs]
        return rules_of_table(names, [rules] if isinstance(rules[0], str) else rules)
    return tuple(rule.rule for rule in rules)


def places_of_rules(keys: AnyFuzzy) -> list[KeyPath]:
    """Return where each rule of the system stands, below the system's own key."""
    rules = keys.rules
    if isinstance(rules[0], tuple):
        return [(RULES, i, j) for i, row in enumerate(rules) for j, word in enumerate(row) if word != NONE]
    return [(RULES, i) for i, word in enumerate(rules) if word != NONE]
