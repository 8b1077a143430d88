"""Fuzzy systems in a config: every key with its type and meaning, and what makes a system of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag, TypeAdapter

from torquebench.errors import Fault, FuzzyError
from torquebench.experiment.groups import Checked, Many, NumberOrList, group_of, number, refusal
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import BROKEN, KeyPath
from torquebench.fuzzy import Functions, FuzzySystem, Rule, Variable
from torquebench.fuzzy.system import rules_of_table
from torquebench.fuzzy.terms import MAX_TERMS, NONE, range_error, shape_errors
from torquebench.keys import Key, Kinds

MAX_SYSTEMS = 64
MAX_RULES = 2 * MAX_TERMS * MAX_TERMS
RULES = "rules"
SHAPE = "one number (a peak), 3 numbers (a triangle) or 4 (a trapezoid)"
FUNCTION = "one number, or a list of a constant and a factor of each input"
RULE_FORMS = "rows of consequents, one row of them for one input, or rules {if: [...], then: ...}"

SYSTEMS = Kinds("kind of fuzzy system")
_NUMBER: Any = number(Key(""))


@dataclass(frozen=True)
class NamedNumbers:
    """Note of a key that takes a mapping of names to one number, or a list of some."""

    least: int
    most: int

    def type(self, describes: bool) -> Any:
        """Return the type for pydantic; see `Spec.type`."""
        if not describes:
            return dict[str, Annotated[Any, NumberOrList(Key(""), least=self.least, most=self.most)]]
        many = Annotated[tuple[_NUMBER, ...], Field(strict=False, min_length=self.least, max_length=self.most)]
        return dict[str, _NUMBER | many]


_RANGE = Key("What the law sees as -1 and 1", wanted="a list of two numbers, such as [-1, 1]")
Shapes: TypeAlias = Mapping[str, float | tuple[float, ...]]


@dataclass(frozen=True, kw_only=True)
class FuzzyFunctions:
    """The output of a Sugeno system: named functions of the inputs."""

    range: Annotated[tuple[float, float], _RANGE] = (-1.0, 1.0)
    functions: Annotated[
        Shapes,
        Key(
            "Name and function: a constant, or a constant and a factor of each input in its own units",
            "1",
            wanted=FUNCTION,
        ),
        NamedNumbers(1, 3),
    ]


@dataclass(frozen=True, kw_only=True)
class FuzzyTerms:
    """The output of a Mamdani system: named terms, which may reach beyond the range."""

    range: Annotated[tuple[float, float], _RANGE] = (-1.0, 1.0)
    terms: Annotated[Shapes, Key("Name and shape, as of an input", "1", wanted=SHAPE), NamedNumbers(3, 4)]


@dataclass(frozen=True, kw_only=True)
class FuzzyInput(FuzzyTerms):
    """A range, to which the input is clipped, and named terms that overlap on it."""

    terms: Annotated[
        Shapes,
        Key(
            "Name and shape, from low to high: a number is the peak of a triangle that reaches to the peaks beside it; "
            "3 numbers are a triangle, 4 a trapezoid",
            "1",
            wanted=SHAPE,
        ),
        NamedNumbers(3, 4),
    ]


def _variable_faults(path: KeyPath, keys: FuzzyTerms | FuzzyFunctions) -> Iterator[Fault]:
    """Yield what is wrong with an input or the output, which stands at a path."""
    message = range_error(*keys.range)
    if message is not None:
        yield Fault((*path, "range"), message)
    for finding in shape_errors(keys.terms) if isinstance(keys, FuzzyTerms) else ():
        yield Fault((*path, *finding.where), finding.message)


def _shape_of_rule(value: object) -> str:
    return "list" if isinstance(value, list | tuple) else "word"


_WORDS: Any = Annotated[tuple[Annotated[str, Field(strict=True)], ...], Field(strict=False, min_length=1)]
_WHEN: TypeAdapter[Any] = TypeAdapter(
    Annotated[
        Annotated[str, Field(strict=True), Tag("word")] | Annotated[_WORDS, Tag("list")], Discriminator(_shape_of_rule)
    ]
)


@dataclass(frozen=True)
class FuzzyRule:
    """One rule, where rules are not a table."""

    when: Annotated[
        str | tuple[str, ...],
        Key("A term of each input; all must hold", name="if", wanted="names"),
        Checked(_WHEN.validate_python, str | Annotated[list[str], Field(min_length=1, max_length=2)]),
    ]
    then: Annotated[str, Key("Name of the consequent")]


_RULE: Any = group_of(FuzzyRule).type(False)
_FORMS: Mapping[type, TypeAdapter[Any]] = {
    str: TypeAdapter(_WORDS),
    list: TypeAdapter(Annotated[tuple[_WORDS, ...], Field(strict=False)]),
    dict: TypeAdapter(Annotated[tuple[_RULE, ...], Field(strict=False)]),
}
_ROW = Annotated[list[str], Field(min_length=1, max_length=MAX_TERMS)]


def _check_rules(raw: Any) -> Any:
    """Return rules, all of one form."""
    if not isinstance(raw, list) or not 1 <= len(raw) <= MAX_RULES:
        raise refusal([Fault((), wanted=f"a list: {RULE_FORMS}")], raw)
    form = next((form for form in _FORMS if isinstance(raw[0], form)), None)
    if form is None:
        raise refusal([Fault((0,), got=shown(raw[0]), wanted=RULE_FORMS)], raw)
    like = f"{shown(raw[0])} like the first: {RULE_FORMS}"
    odd = [(i, item) for i, item in enumerate(raw) if not isinstance(item, form) and item is not BROKEN]
    if odd and form is not str:
        raise refusal([Fault((i,), got=shown(item), wanted=like) for i, item in odd], raw)
    return _FORMS[form].validate_python(raw)


@dataclass(frozen=True, kw_only=True)
class AnyFuzzy:
    """Keys that every fuzzy system has."""

    kind: ClassVar[str]
    inputs: Annotated[
        tuple[FuzzyInput, ...],
        Key("One or two inputs, in the order in which the law gives them", wanted="a list of one or two inputs"),
        Many("inputs", 1, 2, group_of(FuzzyInput)),
    ]
    rules: Annotated[
        tuple[Any, ...],
        Key(
            "A table of consequents, a row for each term of input 1 with a column for each of input 2 (for one input a "
            "single row), none where there is no rule; or a list of rules"
        ),
        Checked(
            _check_rules,
            Annotated[list[str | _ROW | group_of(FuzzyRule).model(True)], Field(min_length=1, max_length=MAX_RULES)],
            Many("rules", 1, MAX_RULES, group_of(FuzzyRule)),
        ),
    ]
    conjunction: Annotated[Literal["min", "product"], Key("AND of two inputs")] = "min"
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
    return tuple(Rule((rule.when,) if isinstance(rule.when, str) else rule.when, rule.then) for rule in rules)


def places_of_rules(keys: AnyFuzzy) -> list[KeyPath]:
    """Return where each rule of the system stands, below the system's own key."""
    rules = keys.rules
    if isinstance(rules[0], tuple):
        return [(RULES, i, j) for i, row in enumerate(rules) for j, word in enumerate(row) if word != NONE]
    return [(RULES, i) for i, word in enumerate(rules) if word != NONE]
