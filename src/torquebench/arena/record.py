"""The record of an arena, ``arena.json``, from which everything is ranked again without another run."""

from __future__ import annotations

import ast
import contextlib
import copy
import dataclasses
import hashlib
import inspect
import itertools
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from torquebench.arena.ranking import TOLERANCE, Scores, Standing, best_at, is_open, mean_of, mean_over_runs, rank
from torquebench.dialect import definition, module_of, plain
from torquebench.errors import ResultError, did_you_mean
from torquebench.experiment.arena_section import CHATTERING
from torquebench.experiment.store import read_stored
from torquebench.experiment.values import from_json
from torquebench.keys import Vector
from torquebench.laws import find_law, law_names
from torquebench.laws.law import Law, functions_named
from torquebench.sim.sandbox import SandboxedLaw, imports_of
from torquebench.syntax import parse_python

FORMAT = 1
TUNED, SELF = "tuned", "self"
"""Rulesets: gains that tuning found within the budget; gains that the law has by itself, without any evaluation."""
RULESETS = {TUNED: "tuned", SELF: "as given: no evaluation but the law's own adaptation"}
LEAST = 1e-6
"""Chattering counts as at least this where its geometric mean is taken [% of the torque limit]."""
SHIPPED = "torquebench"
"""Source of a law that is in no file of the user's own."""
DIGITS = 4
"""Significant digits of what is stored."""

Values = dict[str, dict[str, tuple[float | None, ...]]]
"""Condition -> metric -> its value in each draw; None where the run failed. One value where nothing is random."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One set of gains, and what came of it on the test draws."""

    seed: int | None
    """The tuning that found it; None for the gains that the entry had."""
    gains: dict[str, float | tuple[float, ...]]
    chattering: float | None
    error: float | None
    """Geometric means over training conditions and draws, as the tuning saw them; None where a run failed."""
    values: Values


@dataclass(frozen=True, kw_only=True)
class Row:
    """An entry on a chain."""

    chain: str
    entry: str
    law: str
    options: dict[str, str | bool]
    fuzzy: str | None = None
    source: str
    """`SHIPPED`, or the name of the file that has the law."""
    digest: str
    """As of `digest_of`."""
    loops: int
    """Closed loops that tuning ran, over all seeds."""
    seconds: float
    """Their length together [s]."""
    fronts: tuple[tuple[tuple[float, float], ...], ...]
    """Of each tuning the best choices that it found: chattering and error, neither of which another one beats."""
    judged: tuple[Judged, ...]

    @property
    def name(self) -> str:
        """Name of the row: ``CHAIN/ENTRY``."""
        return f"{self.chain}/{self.entry}"

    @property
    def state(self) -> str:
        """Reason why the row has expired; empty while its law is there unchanged."""
        if self.law not in law_names():
            where = f"any more, unless --plugin names {self.source}" if self.source != SHIPPED else "any more"
            return f"expired: law '{self.law}' is not there {where}"
        if digest_of(find_law(self.law)) == self.digest:
            return ""
        return "expired: its law, or a function that it shares with others, has changed since"


@dataclass(frozen=True, kw_only=True)
class Record:
    """An arena: its study, its budget, its seal, and its rows."""

    format: int = FORMAT
    name: str
    date: str
    software: dict[str, str]
    machine: dict[str, str]
    study: str
    """The config, whole."""
    arms: dict[str, str] = field(default_factory=dict)
    seal: dict[str, str]
    """``commitment``, the hash that was written before the first run; ``secret``, revealed after the last."""
    metric: str
    metrics: tuple[str, ...]
    levels: tuple[float, ...]
    """Chattering at which laws are compared [% of the torque limit]."""
    chains: tuple[str, ...]
    burdens: tuple[str, ...]
    held_out: tuple[str, ...]
    evaluations: int
    seeds: int
    draws: int
    """Of each condition in which something is random; where there are several looks, at most."""
    looks: int = 1
    """Number of comparisons made while draws came in; see `looks_at`."""
    rows: tuple[Row, ...]

    def row(self, name: str) -> Row:
        """Return the row called ``CHAIN/ENTRY``.

        Raises:
            ResultError: there is none.
        """
        found = {row.name: row for row in self.rows}
        if name not in found:
            raise ResultError(f"no row '{name}'{did_you_mean(name, found)}")
        return found[name]

    def scores(self, row: Row, level: float, metric: str = "", ruleset: str = TUNED, held_out: bool = False) -> Scores:
        """Return a row's scores at a level of chattering, in the draws that all its gains were judged in.

        Args:
            row: The row.
            level: Chattering on training conditions that its gains do not exceed [% of the torque limit].
            metric: What is compared; the arena's own if left out.
            ruleset: One of `RULESETS`.
            held_out: Whether under the held-out conditions instead of the burdens.

        Raises:
            ResultError: the metric is not stored, or a tuning has no gains of this level.
        """
        if (metric or self.metric) not in self.metrics:
            raise ResultError(f"metric '{metric}' is not stored{did_you_mean(metric, self.metrics)}")
        names = self.held_out if held_out else self.burdens
        picked = picks(row, level, ruleset)
        missing = sum(one is None for one in picked)
        if missing:
            few = f" in {missing} of {len(picked)} tunings" if missing < len(picked) else ""
            raise ResultError(f"does not reach {level:g} %{few}")
        tables = [[_row_of(one.values[name][metric or self.metric]) for name in names] for one in picked if one]
        once = frozenset(i for i in range(len(names)) if all(len(table[i]) == 1 for table in tables))
        draws = min((len(x) for table in tables for i, x in enumerate(table) if i not in once), default=1)
        values = [[np.broadcast_to(x, draws) if i in once else x[:draws] for i, x in enumerate(t)] for t in tables]
        return Scores(np.array(values).reshape(len(tables), len(names), draws), once)

    def standings(
        self, chain: str, level: float, metric: str = "", ruleset: str = TUNED, held_out: bool = False
    ) -> list[Standing]:
        """Return where each entry of a chain stands, the best first; those that are not ranked come last, with why.

        It is worked out once, for the tables, the figure and the page have the same ranks, and anew where a law of the
        chain has come, gone or changed.

        Args:
            chain: The chain.
            level, metric, ruleset, held_out: As of `scores`.
        """
        states = tuple(row.state for row in self.rows if row.chain == chain)
        asked = chain, level, metric, ruleset, held_out, states
        if asked not in self._found:
            self._found[asked] = self._stand(chain, level, metric, ruleset, held_out)
        return list(self._found[asked])

    @cached_property
    def _found(self) -> dict[tuple[Any, ...], list[Standing]]:
        return {}

    def _stand(self, chain: str, level: float, metric: str, ruleset: str, held_out: bool) -> list[Standing]:
        """Return where each entry of a chain stands; arguments as of `standings`."""
        known, chattering, notes = self._shown(chain, level, metric, ruleset, held_out)
        ranks = rank({name: own for name, own in known.items() if not notes[name]}, looks=self.looks)
        found = []
        for name, note in notes.items():
            if name in known:
                own = known[name]
                runs, failed = own.values.shape[0] * len(own.runs), own.values.shape[0] * float(own.runs.sum())
                value, low, high, tuning = mean_of(own)
                where = value, low, high, tuning, chattering[name], round(failed), runs
            else:
                where = math.nan, math.nan, math.nan, math.nan, math.nan, 0, 0
            first, last = ranks.get(name, (None, None))
            found.append(Standing(name, first, last, *where, note))
        return sorted(
            found,
            key=lambda one: (one.rank or math.inf, one.last or 0, one.value if one.value == one.value else math.inf),
        )

    def _shown(
        self, chain: str, level: float, metric: str, ruleset: str, held_out: bool, draws: int | None = None
    ) -> tuple[dict[str, Scores], dict[str, float], dict[str, str]]:
        """Return scores, and chattering, of entries that reach a level, and of all why they are not ranked, or "".

        Args:
            chain, level, metric, ruleset, held_out: As of `scores`.
            draws: How many count; None for all.
        """
        known, notes = dict[str, Scores](), dict[str, str]()
        chattering = dict[str, float]()
        for row in self.rows:
            if row.chain != chain:
                continue
            try:
                own = self.scores(row, level, metric, ruleset, held_out).first(draws)
                measured = self.scores(row, level, CHATTERING, ruleset, held_out).first(draws)
            except ResultError as error:
                notes[row.entry] = row.state or str(error)
                continue
            known[row.entry] = own
            chattering[row.entry] = mean_over_runs(measured, LEAST)
            above = f"chatters {chattering[row.entry]:.3g} % on test draws"
            seen = chattering[row.entry] if not held_out else 0.0
            notes[row.entry] = row.state or (above if seen > TOLERANCE * level else "")
        return known, chattering, notes

    def undecided(self, chain: str, draws: int) -> set[tuple[str, float]]:
        """Return entries and levels of which a pair may tie for want of draws; see `is_open`.

        Args:
            chain: The chain.
            draws: How many were looked at.
        """
        found = set[tuple[str, float]]()
        for level in self.levels:
            known, _, notes = self._shown(chain, level, "", TUNED, held_out=False, draws=draws)
            shown = {name: own for name, own in known.items() if not notes[name]}
            for a, b in itertools.combinations(shown, 2):
                if is_open(shown[a], shown[b], looks=self.looks):
                    found |= {(a, level), (b, level)}
        return found

    def to_json(self) -> bytes:
        """Return the file: a line for each row."""
        facts = {key: value for key, value in dataclasses.asdict(self).items() if key != "rows"}
        head = json.dumps(facts, indent=1, ensure_ascii=False).removesuffix("\n}")
        rows = ",\n".join(json.dumps(dataclasses.asdict(row), separators=(",", ":")) for row in self.rows)
        return f'{head},\n "rows": [\n{rows}\n]}}\n'.encode()


def looks_at(draws: int, looks: int) -> list[int]:
    """Return the numbers of draws after which laws are compared: each look has about twice those of the one before.

    Args:
        draws: At most, two or more.
        looks: How many looks.
    """
    return sorted({max(2, math.ceil(draws / 2**i)) for i in range(looks)})


def _row_of(values: Iterable[float | None]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([math.nan if x is None else x for x in values])


def picks(row: Row, level: float, ruleset: str = TUNED) -> list[Judged | None]:
    """Return the gains of each tuning that have the least training error at no more training chattering than a level.

    Args:
        row: The row.
        level: The level [% of the torque limit].
        ruleset: One of `RULESETS`; without tuning there is one set of gains.
    """
    found = list[Judged | None]()
    for seed in range(len(row.fronts)) if ruleset == TUNED else [None]:
        own = [one for one in row.judged if one.seed == seed]
        points = [
            (math.inf, math.nan) if one.chattering is None or one.error is None else (one.chattering, one.error)
            for one in own
        ]
        at = best_at(points, level)
        found.append(None if at is None else own[at])
    return found


@lru_cache(maxsize=256)
def digest_of(law: Law) -> str:
    """Return the digest of a law as it is parsed: comments, docstrings and layout do not count.

    In it are its file, and what it calls in files of `SHARED` besides. The arm's dynamics are not: they are those of
    the plant, and belong to the version of the package.
    """
    own = law.function
    if isinstance(own, SandboxedLaw):
        tree, roots = parse_python(own.text), list(_imported(own.text))
    else:
        tree, roots = module_of(own), [own]
    named = {f: None for root in roots for f in (plain(root), *functions_named(root)) if hasattr(f, "__code__")}
    others = [f for f in named if f.__module__.startswith(SHARED) and f.__module__ != own.__module__]
    parts = [
        _bare(tree),
        *sorted(f"{f.__module__}.{f.__qualname__} {_bare(definition(f))} {_numbers_of(f)}" for f in others),
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


SHARED = ("torquebench.laws.", "torquebench.fuzzy.", "torquebench.kernel")
"""Modules of the functions that laws share."""


def _imported(text: str) -> Iterator[Any]:
    """Yield what a file takes from the package by name."""
    for module, *names in imports_of(text):
        if module.partition(".")[0] == "torquebench":
            with contextlib.suppress(ImportError):
                yield from (getattr(import_module(module), name, None) for name in names)


def _bare(node: ast.AST | None) -> str:
    """Return the text of a syntax tree without its docstrings."""
    node = copy.deepcopy(node or ast.Module([], []))
    for part in ast.walk(node):
        match getattr(part, "body", None):
            case [ast.Expr(value=ast.Constant()), *rest]:
                part.body = rest  # type: ignore[attr-defined]
    return ast.dump(node)


def _numbers_of(function: FunctionType) -> dict[str, Any]:
    """Return the constants that a function reads."""
    known = inspect.getclosurevars(function).globals
    return {name: x for name, x in sorted(known.items()) if isinstance(x, int | float | str | tuple)}


def source_of(law: Law) -> str:
    """Return `SHIPPED` for a law that ships, else the name of its file."""
    if law.ships:
        return SHIPPED
    file = law.function.file if isinstance(law.function, SandboxedLaw) else inspect.getsourcefile(law.function)
    return Path(file or "").name


def stored(x: float) -> float | None:
    """Return a number as it is stored: in `DIGITS` digits, None where it is not finite."""
    return float(f"{x:.{DIGITS}g}") if math.isfinite(x) else None


def plain_gains(gains: Mapping[str, Vector]) -> dict[str, float | tuple[float, ...]]:
    """Return gains as they are stored."""
    return {name: tuple(map(float, x)) if isinstance(x, tuple) else float(x) for name, x in gains.items()}


def read_record(path: Path) -> Record:
    """Read ``arena.json``.

    Args:
        path: The file, or its folder.

    Raises:
        ResultError: it is no such file.
    """
    path = path / "arena.json" if path.is_dir() else path
    try:
        found = from_json(Record, read_stored(path))
    except OSError as error:
        raise ResultError(f"{path}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:
        raise ResultError(f"{path}: is no arena ({str(error).splitlines()[0]})") from error
    if found.format != FORMAT:
        raise ResultError(f"{path}: has format {found.format}, this version reads {FORMAT}")
    if strange := [row.name for row in found.rows if row.chain not in found.chains]:
        raise ResultError(f"{path}: row '{strange[0]}' is on a chain that the arena does not have")
    return found
