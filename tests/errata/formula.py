r"""A small parser for the two ways formulas are written here: the paper's LaTeX and the docstrings' plain text.

Docstrings write `C2`, `S23`, `S223` for the cosine or sine of theta2, theta2 + theta3, 2 theta2 + theta3; the paper
writes `\sin(\theta_2 + \theta_3)`. Both give the same tree, so that texts can be compared as well as values. In both,
things side by side are multiplied. Text is split by one regular expression and never executed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

Tree = tuple[Any, ...]
"""("num", x), ("name", s), ("sin" | "cos" | "neg" | "sq", tree), ("+" | "*", tree, ...)."""

_TOKEN = re.compile(
    r"\s+|(?P<skip>\\times|\\cdot)|(?P<number>\d+(?:\.\d+)?)|\\(?P<function>sin|cos)|\\theta_(?P<theta>\d)"
    r"|\\dot\{q\}_(?P<speed>\d)|(?P<short>[SC]\d+)|(?P<letter>[A-Za-z])_(?:\{(?P<long>m?\d+)\}|(?P<one>\d))"
    r"|(?P<plain>I\d+|Im\d|g\d)|(?P<mark>[-+()\[\]]|\^2)"
)
_OPEN = {"(": ")", "[": "]"}


class FormulaError(ValueError):
    """The text is not a formula of these two kinds."""


def _angle_sum(digits: str) -> Tree:
    thetas = [("name", f"theta{d}") for d in digits]
    return thetas[0] if len(thetas) == 1 else ("+", *thetas)


def _tokens(text: str) -> list[Tree]:
    found: list[Tree] = []
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise FormulaError(f"cannot read {text[at : at + 20]!r}")
        at = match.end()
        part = match.groupdict()
        if part["number"]:
            found.append(("num", float(part["number"])))
        elif part["function"]:
            found.append(("call", part["function"]))
        elif part["theta"]:
            found.append(("name", f"theta{part['theta']}"))
        elif part["speed"]:
            found.append(("name", f"qd{part['speed']}"))
        elif part["short"]:
            found.append(({"S": "sin", "C": "cos"}[part["short"][0]], _angle_sum(part["short"][1:])))
        elif part["letter"]:
            letter = {"C": "c"}.get(part["letter"], part["letter"])  # the paper writes both C_{12} and c_{12}
            found.append(("name", letter + (part["long"] or part["one"])))
        elif part["plain"]:
            found.append(("name", part["plain"]))
        elif part["mark"]:
            found.append(("mark", part["mark"]))
    return found


def parse(text: str) -> Tree:
    """Return the tree of a formula in either notation.

    Raises:
        FormulaError: the text is something else.
    """
    tokens = _tokens(text)
    tree, rest = _sum(tokens)
    if rest:
        raise FormulaError(f"left over in {text!r}: {rest[0]}")
    return tree


def _sum(tokens: list[Tree]) -> tuple[Tree, list[Tree]]:
    terms: list[Tree] = []
    sign = "+"
    if tokens and tokens[0] in (("mark", "-"), ("mark", "+")):
        sign, tokens = tokens[0][1], tokens[1:]
    while True:
        term, tokens = _product(tokens)
        terms.append(("neg", term) if sign == "-" else term)
        if not tokens or tokens[0] not in (("mark", "-"), ("mark", "+")):
            return (terms[0] if len(terms) == 1 else ("+", *terms)), tokens
        sign, tokens = tokens[0][1], tokens[1:]


def _product(tokens: list[Tree]) -> tuple[Tree, list[Tree]]:
    factors: list[Tree] = []
    while tokens and (tokens[0][0] != "mark" or tokens[0][1] in _OPEN):
        head, tokens = tokens[0], tokens[1:]
        if head[0] == "mark":
            factor, tokens = _closed(head[1], tokens)
        elif head[0] == "call":
            if not tokens or tokens[0] != ("mark", "("):
                raise FormulaError(f"{head[1]} without a bracket")
            inner, tokens = _closed("(", tokens[1:])
            factor = (head[1], inner)
        else:
            factor = head
        if tokens and tokens[0] == ("mark", "^2"):
            factor, tokens = ("sq", factor), tokens[1:]
        factors.append(factor)
    if not factors:
        raise FormulaError("a sign or bracket without anything to stand on")
    return (factors[0] if len(factors) == 1 else ("*", *factors)), tokens


def _closed(opening: str, tokens: list[Tree]) -> tuple[Tree, list[Tree]]:
    tree, tokens = _sum(tokens)
    if not tokens or tokens[0] != ("mark", _OPEN[opening]):
        raise FormulaError(f"bracket {opening} is not closed")
    return tree, tokens[1:]


def evaluate(tree: Tree, values: Mapping[str, Any]) -> Any:
    """Return the value of `tree` with its names looked up in `values` (numbers or arrays that broadcast)."""
    kind = tree[0]
    if kind == "num":
        return tree[1]
    if kind == "name":
        return values[tree[1]]
    parts = [evaluate(part, values) for part in tree[1:]]
    if kind == "+":
        return sum(parts[1:], start=parts[0])
    if kind == "*":
        result = parts[0]
        for part in parts[1:]:
            result = result * part
        return result
    return {"sin": np.sin, "cos": np.cos, "neg": np.negative, "sq": np.square}[kind](parts[0])


def names(tree: Tree) -> set[str]:
    """Return the names that occur in `tree`."""
    if tree[0] == "name":
        return {tree[1]}
    return set().union(*(names(part) for part in tree[1:] if isinstance(part, tuple)))


def text(tree: Tree) -> str:
    """Write `tree` in the docstrings' notation."""
    kind = tree[0]
    if kind == "num":
        return f"{tree[1]:g}"
    if kind == "name":
        return str(tree[1])
    if kind in ("sin", "cos"):
        inner = tree[1]
        terms = inner[1:] if inner[0] == "+" else (inner,)
        if all(t[0] == "name" and t[1].startswith("theta") for t in terms):
            return kind[0].upper() + "".join(t[1][5:] for t in terms)
        return f"{kind}({text(inner)})"
    if kind == "neg":
        return f"-{_grouped(tree[1])}"
    if kind == "sq":
        return f"{_grouped(tree[1])}^2"
    if kind == "*":
        return " ".join(f"[{text(part)}]" if part[0] == "*" else _grouped(part) for part in tree[1:])
    written = text(tree[1])
    for part in tree[2:]:
        written += f" - {_grouped(part[1])}" if part[0] == "neg" else f" + {_grouped(part)}"
    return written


def _grouped(tree: Tree) -> str:
    inner = text(tree)
    if tree[0] not in ("+", "neg"):
        return inner
    return f"[{inner}]" if "(" in inner else f"({inner})"


def sides(latex: str) -> list[str]:
    """Split a printed line at its equals signs: label, further claims, and the formula last."""
    return [side.strip() for side in " ".join(latex.split()).split("=")]


def matrix(latex: str) -> list[list[str]]:
    """Return the entries of the first LaTeX matrix in `latex`, row by row."""
    flat = " ".join(latex.split())
    body = flat.split(r"\begin{bmatrix}")[1].split(r"\end{bmatrix}")[0]
    return [[entry.strip() for entry in row.split("&")] for row in body.split(r"\\")]
