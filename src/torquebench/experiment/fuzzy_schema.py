"""Every key of a fuzzy system: its type, default and meaning."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import AfterValidator, Field, create_model

from torquebench.experiment.keys import Keys
from torquebench.experiment.values import positive_zero
from torquebench.fuzzy.terms import MAX_TERMS

MAX_SYSTEMS = 64
MAX_RULES = 2 * MAX_TERMS * MAX_TERMS

_Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False), AfterValidator(positive_zero)]
_Range: TypeAlias = Annotated[tuple[_Number, _Number], Field(strict=False)]
_Corners: TypeAlias = Annotated[tuple[_Number, ...], Field(strict=False, min_length=3, max_length=4)]
_Factors: TypeAlias = Annotated[tuple[_Number, ...], Field(strict=False, min_length=1, max_length=3)]
_Words: TypeAlias = Annotated[tuple[str, ...], Field(strict=False, min_length=1, max_length=MAX_TERMS)]

_Both: TypeAlias = Annotated[tuple[str, ...], Field(strict=False, min_length=1, max_length=2)]

_RANGE = "What the law sees as -1 and 1."


class FuzzyInput(Keys):
    """A range, to which the input is clipped, and named terms that overlap on it."""

    range: _Range = Field((-1.0, 1.0), description=_RANGE)
    terms: dict[str, _Number | _Corners] = Field(
        description="Name and shape, from low to high: a number is the peak of a triangle that reaches to the peaks "
        "beside it; 3 numbers are a triangle, 4 a trapezoid [1]."
    )


class FuzzyTerms(Keys):
    """The output of a Mamdani system: named terms, which may reach beyond the range."""

    range: _Range = Field((-1.0, 1.0), description=_RANGE)
    terms: dict[str, _Number | _Corners] = Field(description="Name and shape, as of an input [1].")


class FuzzyFunctions(Keys):
    """The output of a Sugeno system: named functions of the inputs."""

    range: _Range = Field((-1.0, 1.0), description=_RANGE)
    functions: dict[str, _Number | _Factors] = Field(
        description="Name and function: a constant, or a constant and a factor of each input in its own units [1]."
    )


_RULE: dict[str, Any] = {
    "if": (str | _Both, Field(description="A term of each input; all must hold.")),
    "then": (str, Field(description="Name of the consequent.")),
}
FuzzyRule = create_model("FuzzyRule", __base__=Keys, __doc__="One rule, where rules are not a table.", **_RULE)


class AnyFuzzy(Keys):
    """Keys that every fuzzy system has."""

    kind: str = Field(description="Method: consequents are terms (mamdani) or functions of the inputs (sugeno).")
    inputs: Annotated[tuple[FuzzyInput, ...], Field(strict=False)] = Field(
        min_length=1, max_length=2, description="One or two inputs, in the order in which the law gives them."
    )
    rules: Annotated[tuple[str | _Words | FuzzyRule, ...], Field(strict=False)] = Field(
        min_length=1,
        max_length=MAX_RULES,
        description="A table of consequents, a row for each term of input 1 with a column for each of input 2 (for one "
        "input a single row), none where there is no rule; or a list of rules.",
    )
    conjunction: Literal["min", "product"] = Field("min", description="AND of two inputs.")


class MamdaniSystem(AnyFuzzy):
    """Consequents are terms of the output; the output is the centre of what the rules leave of them."""

    kind: Literal["mamdani"] = Field(description="Method: consequents are terms (mamdani) or functions of the inputs.")
    output: FuzzyTerms = Field(description="The output's range and terms.")
    aggregation: Literal[
        "max-min",
        "sum-min",
        "max-bounded-product",
        "max-drastic-product",
        "max-bounded-sum",
        "max-algebraic-sum",
        "min-max",
    ] = Field("max-min", description="How the rules' consequents become one set.")
    defuzzification: Literal["coa", "cog"] = Field(
        "coa", description="Centre of the aggregated set (coa), or of all rules' sets added up (cog)."
    )


class SugenoSystem(AnyFuzzy):
    """Consequents are functions of the inputs; the output is their mean, weighted by how much each rule fires."""

    kind: Literal["sugeno"] = Field(description="Method: consequents are terms (mamdani) or functions of the inputs.")
    output: FuzzyFunctions = Field(description="The output's range and functions.")


FuzzyKeys: TypeAlias = MamdaniSystem | SugenoSystem
