"""The section ``audit`` of a config: conditions, claims, and what each claim is judged by."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

from torquebench.audit.verdicts import Threshold
from torquebench.certificates import FIGURES
from torquebench.errors import nearest
from torquebench.experiment.conditions import check_keys
from torquebench.experiment.groups import AUDIT, Many, Named, group_of
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document
from torquebench.experiment.sweep_section import MAX_DRAWS
from torquebench.experiment.values import Anything, Here, Value
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import KeyPath
from torquebench.keys import Key
from torquebench.metrics import applicable
from torquebench.references import REFERENCES
from torquebench.references.reference import depends_on_arm
from torquebench.registry import SLUG

ALL, DRAWS = "all", "draws"
FEEDFORWARD = "feedforward"
"""Share of the inverse dynamics that a law supplies at zero error: a figure of a law, not of a run."""
MAX_CLAIMS = 64
MAX_CASES = 2000
"""Cases that one claim may have."""
MAX_WORDS = 25
"""Words of a sentence that stands in a cell of a table."""


@dataclass(frozen=True, kw_only=True)
class Paper:
    """The publication whose claims are judged."""

    title: Annotated[str, Key("Title")]
    authors: Annotated[str | None, Key("Authors")] = None
    published: Annotated[str | None, Key("Journal or publisher, volume, pages")] = None
    year: Annotated[int | None, Key("Year", "1", at_least=1600, at_most=2200)] = None

    def __str__(self) -> str:
        return ", ".join(str(part) for part in (self.authors, self.title, self.published, self.year) if part)


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A figure, what it is set against, and the threshold that was named before looking."""

    figure: Annotated[
        str,
        Key(
            "A metric, a figure of certificates.json, or feedforward: the share of the inverse dynamics that a law "
            "supplies at zero error"
        ),
    ]
    relation: Annotated[
        Literal["value", "ratio", "difference", "share"],
        Key(
            "value: the mean over draws; ratio, difference: to the second law of the pair, or to another condition, "
            "paired by draw; share: of the draws that counts says",
            name="as",
        ),
    ] = "value"
    below: Annotated[float | None, Key("The claim holds below this; in the figure's SI unit", "1")] = None
    above: Annotated[float | None, Key("The claim holds above this; in the figure's SI unit", "1")] = None
    floor: Annotated[float | None, Key("Figures of a ratio count as at least this", "1", above=0)] = None
    counts: Annotated[
        Any,
        Key("Which draws a share counts: {above: 0} or {below: 0}"),
        Anything(),
    ] = None
    against: Annotated[
        Any,
        Key("Another condition that the same law is set against: axis -> level, the other axes as in the case"),
        Anything(),
    ] = None
    why: Annotated[str, Key("Why this threshold")]

    @property
    def threshold(self) -> Threshold:
        """The threshold with its side."""
        limit, side = (self.above, "above") if self.below is None else (self.below, "below")
        return Threshold(float(limit or 0.0), side)

    @property
    def counted(self) -> Threshold:
        """The threshold that a draw must meet to be counted in a share."""
        ((side, limit),) = self.counts.items()
        return Threshold(float(limit), side)


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A sentence, where it stands, and what decides whether it holds."""

    says: Annotated[str, Key("The claim in a sentence of at most 25 words")]
    where: Annotated[str, Key("Equation, figure or page, with a word of what it is")]
    quoted: Annotated[str | None, Key("The words of the text, if it says so")] = None
    implied: Annotated[str | None, Key("What implies it, if the text does not say so")] = None
    pairs: Annotated[
        Any,
        Key("Label -> the controller judged, or [judged, beside]: like with like, a model on both sides or on neither"),
        Anything(),
    ]
    unlike: Annotated[
        Any,
        Key("Pairs as under pairs that are shown and not judged, because they are not alike"),
        Anything(),
    ] = None
    measures: Annotated[
        tuple[Measure, ...],
        Key("Figures that decide a case: it holds where all do, and fails where one does"),
        Many("measures", 1, 8, group_of(Measure)),
    ]
    under: Annotated[
        Any,
        Key(
            "Conditions: axis -> a level, a list of them, or all; the first level of an axis left out; draws, if "
            "not the study's. A list of such mappings for several sets"
        ),
        Anything(),
    ] = None
    ablations: Annotated[
        Any,
        Key(
            "Laws that may do as well: label -> [controller, the judged one]; the first measure's figure, as ratio, "
            "under the claim's conditions or those of ablated_under"
        ),
        Anything(),
    ] = None
    ablated_under: Annotated[Any, Key("Conditions of the ablations, as under"), Anything()] = None
    expect: Annotated[
        Literal["holds", "fails", "depends", "undecided"] | None,
        Key("Verdict that is expected; another one makes the exit status 1"),
    ] = None


@dataclass(frozen=True, kw_only=True)
class AuditKeys:
    """A study: conditions under which the file's controllers are run, and claims about what comes out."""

    paper: Annotated[Paper | None, Key("The publication whose claims these are")] = None
    open: Annotated[
        tuple[str, ...],
        Key("What the publication leaves open, a list of sentences"),
        Many("sentences", 0, 50, Value(Key("A sentence"), str)),
    ] = ()
    draws: Annotated[
        int,
        Key("Draws of each condition in which something is random", "1", at_least=1, at_most=MAX_DRAWS),
    ] = 30
    conditions: Annotated[
        Any,
        Key(
            "Axis -> level -> the keys that it sets, as for --set; a case of a claim has one level of each axis. Cases "
            "are grouped by the first axis"
        ),
        Named("a mapping of axes to levels", Anything(), most=16),
    ] = field(default_factory=dict)
    claims: Annotated[
        Mapping[str, Claim],
        Key("What is judged, by name"),
        Named("a mapping of names to claims", group_of(Claim), names=SLUG, least=1, most=MAX_CLAIMS),
    ]


Condition: TypeAlias = tuple[str, ...]
"""A level of each axis, in the file's order."""


class Pair(NamedTuple):
    """The controller that a case judges, and the one beside it."""

    label: str
    of: str
    over: str | None
    like: bool
    """Whether it is judged; else it is shown only."""


class Question(NamedTuple):
    """A claim with its pairs and conditions spelled out."""

    key: str
    claim: Claim
    pairs: tuple[Pair, ...]
    conditions: Mapping[Condition, int]
    """With the draws of each."""
    ablations: tuple[Pair, ...]
    ablated: Mapping[Condition, int]


class Study(NamedTuple):
    """A config's section ``audit`` without mistakes, and the experiment that it varies."""

    document: Document
    """The experiment, without the section."""
    file: Document
    """The whole file, which knows where everything is written."""
    audit: AuditKeys
    axes: Mapping[str, Mapping[str, Mapping[str, Any]]]
    """Axis -> level -> dotted key -> value."""
    questions: tuple[Question, ...]

    @property
    def laws(self) -> dict[str, str]:
        """Controller -> name of its law."""
        return {keys["name"]: keys["law"] for keys in self.document.root["controllers"]}

    def words(self, condition: Condition) -> str:
        """Return a condition in words: its level on the first axis, and on others where it is not the first level."""
        usual = [next(iter(levels)) for levels in self.axes.values()]
        told = [level for i, level in enumerate(condition) if i == 0 or level != usual[i]]
        return ", ".join(told) or "all"

    def moved(self, condition: Condition, to: Mapping[str, str]) -> Condition:
        """Return a condition with other levels on some axes."""
        return tuple(to.get(axis, level) for axis, level in zip(self.axes, condition, strict=True))

    def needs(self) -> dict[Condition, tuple[list[str], int]]:
        """Return the controllers that must be run under each condition, in the file's order, and in how many draws."""
        found: dict[Condition, set[str]] = {}
        draws: dict[Condition, int] = {}
        for question in self.questions:
            for condition, name, least in _needs(self, question):
                found.setdefault(condition, set()).add(name)
                draws[condition] = max(draws.get(condition, 1), least)
        levels = [list(levels) for levels in self.axes.values()]
        order = [keys["name"] for keys in self.document.root["controllers"]]
        return {
            condition: ([name for name in order if name in found[condition]], draws[condition])
            for condition in itertools.product(*levels)
            if condition in found
        }


def _needs(study: Study, question: Question) -> Iterator[tuple[Condition, str, int]]:
    """Yield each condition with a controller that must be run under it, and in how many draws at least."""
    for pairs, conditions in ((question.pairs, question.conditions), (question.ablations, question.ablated)):
        for pair, (condition, draws) in itertools.product(pairs, conditions.items()):
            for name in filter(None, (pair.of, pair.over)):
                yield condition, name, draws
    for measure in question.claim.measures:
        if measure.against is not None:
            for pair, (condition, draws) in itertools.product(question.pairs, question.conditions.items()):
                yield study.moved(condition, measure.against), pair.of, draws


def take_audit(document: Document) -> Study:
    """Take the section out of a config and return the study; mistakes are recorded in the document, all of them.

    Raises:
        ConfigError: there is a mistake in the section.
    """
    if AUDIT not in document.root:
        document.add((AUDIT,), "missing: the claims, and the conditions under which they are judged", at="key")
    document.raise_problems()
    audit: AuditKeys = Here(document, group_of(Experiment)).read(group_of(AuditKeys), AUDIT, document.root[AUDIT])
    document.raise_problems()
    names = [item.get("name") for item in document.root.get("controllers", []) if isinstance(item, dict)]
    reader = _Reader(document, audit.draws, dict(audit.conditions), [name for name in names if isinstance(name, str)])
    reader.check_axes()
    document.raise_problems()
    questions = tuple(reader.question(key, claim) for key, claim in audit.claims.items())
    document.raise_problems()
    copy = document.copy()
    del copy.root[AUDIT]
    return Study(copy, document, audit, reader.axes, questions)


def is_of_tool(kind: str) -> bool:
    """Return whether a kind of reference is a path of the tool."""
    return depends_on_arm(REFERENCES.find(kind))


def _values(root: Mapping[str, Any], axes: Mapping[str, Any], section: str, key: str) -> Iterator[Any]:
    """Yield the values that a section's key may have: the config's, and those that conditions set.

    Args:
        root: The config.
        axes: Its conditions, which may have mistakes.
        section: The section.
        key: The key in it.
    """
    own = root.get(section)
    yield own.get(key) if isinstance(own, dict) else None
    for levels in axes.values():
        for keys in levels.values() if isinstance(levels, dict) else ():
            if isinstance(keys, dict) and f"{section}.{key}" in keys:
                yield keys[f"{section}.{key}"]
            if isinstance(keys, dict) and isinstance(keys.get(section), dict):
                yield keys[section].get(key)


class _Reader:
    """Reads what the section names elsewhere: axes, levels, controllers and figures."""

    def __init__(self, document: Document, draws: int, axes: Mapping[str, Any], controllers: Sequence[str]) -> None:
        self.document, self.draws, self.axes, self.controllers = document, draws, axes, controllers
        kinds = {str(kind) for kind in _values(document.root, axes, "reference", "kind")}
        self.of_tool = bool(kinds) and all(kind in REFERENCES and is_of_tool(kind) for kind in kinds)
        """Whether the reference is a path of the tool under each condition."""

    def check_axes(self) -> None:
        """Record axes that are no mappings of levels to keys."""
        for axis, levels in self.axes.items():
            path: KeyPath = (AUDIT, "conditions", axis)
            if axis == DRAWS:
                self.document.add(
                    path, "is the number of draws where conditions are chosen", at="key", wanted="another name"
                )
            if not isinstance(levels, dict) or not levels:
                self.document.add(path, got=shown(levels), wanted="levels, such as {ideal: {chain: ideal}}")
                continue
            for level, keys in levels.items():
                check_keys(self.document, (*path, level), keys, (AUDIT,))
                self._check_overlap((*path, level), axis, keys if isinstance(keys, dict) else {})

    def _check_overlap(self, path: KeyPath, axis: str, keys: Mapping[str, Any]) -> None:
        """Record keys that an earlier axis sets too: the later one would undo what the earlier one is for."""
        before = list(self.axes)[: list(self.axes).index(axis)]
        for other in before:
            levels = self.axes[other].values() if isinstance(self.axes[other], dict) else ()
            taken = {key for own in levels if isinstance(own, dict) for key in own}
            for key in keys:
                undone = next((one for one in taken if one == key or one.startswith(f"{key}.")), None)
                if undone is not None:
                    text = f"undoes what axis '{other}' sets ({undone})"
                    self.document.add((*path, key), text, at="key", wanted="each key on one axis")

    def question(self, key: str, claim: Claim) -> Question:
        """Return a claim with its pairs and conditions spelled out."""
        path: KeyPath = (AUDIT, "claims", key)
        if len(claim.says.split()) > MAX_WORDS:
            self.document.add((*path, "says"), f"has {len(claim.says.split())} words", wanted=f"at most {MAX_WORDS}")
        if (claim.quoted is None) == (claim.implied is None):
            wanted = "the text's own words as quoted, or what implies the claim as implied"
            self.document.add((*path, "quoted"), "one of quoted and implied is needed", wanted=wanted)
        pairs = [
            *self._pairs((*path, "pairs"), claim.pairs, True),
            *self._pairs((*path, "unlike"), claim.unlike or {}, False),
        ]
        under = self._conditions((*path, "under"), claim.under)
        for i, measure in enumerate(claim.measures):
            self._check_measure((*path, "measures", i), measure, pairs)
            against = measure.against if isinstance(measure.against, dict) else {}
            axes = list(self.axes)
            if against and any(
                all(condition[axes.index(axis)] == level for axis, level in against.items() if axis in axes)
                for condition in under
            ):
                self.document.add((*path, "measures", i, "against"), "is the case itself", wanted="another level")
        ablations = tuple(self._pairs((*path, "ablations"), claim.ablations or {}, True))
        for pair in ablations:
            if pair.over is None:
                self.document.add((*path, "ablations", pair.label), wanted="[controller, the one that is judged]")
        ablated = under
        if claim.ablated_under is not None:
            ablated = self._conditions((*path, "ablated_under"), claim.ablated_under)
        if len(pairs) * len(under) > MAX_CASES:
            self.document.add((*path, "under"), f"makes {len(pairs) * len(under)} cases", wanted=f"at most {MAX_CASES}")
        return Question(key, claim, tuple(pairs), under, ablations, ablated)

    def _pairs(self, path: KeyPath, raw: Mapping[str, Any], like: bool) -> Iterator[Pair]:
        if not isinstance(raw, dict) or (path[-1] == "pairs" and not raw):
            self.document.add(path, got=shown(raw), wanted="label: [controller, the one beside it]")
            return
        for label, names in raw.items():
            both = names if isinstance(names, list) else [names]
            if not 1 <= len(both) <= 2 or not all(isinstance(name, str) for name in both):
                self.document.add((*path, label), got=shown(names), wanted="a controller, or [judged, beside]")
                continue
            for i, name in enumerate(both):
                self._check_name((*path, label, i) if isinstance(names, list) else (*path, label), name)
            yield Pair(label, both[0], both[1] if len(both) == 2 else None, like)

    def _check_name(self, path: KeyPath, name: str) -> None:
        if name not in self.controllers:
            near = nearest(name, self.controllers) or ""
            self.document.add(path, "no such controller", got=shown(name), nearest=near, wanted=self._list(near))

    def _list(self, near: str) -> str:
        return "" if near else f"one of {', '.join(self.controllers)}"

    def _check_measure(self, path: KeyPath, measure: Measure, pairs: Sequence[Pair]) -> None:
        add = self.document.add
        figures = (*(info.key for info in applicable(self.of_tool)), *FIGURES, FEEDFORWARD)
        if measure.figure not in figures:
            near = nearest(measure.figure, figures) or ""
            wanted = "" if near else f"one of {', '.join(figures)}"
            add((*path, "figure"), "no such figure", got=shown(measure.figure), nearest=near, wanted=wanted)
        if (measure.below is None) == (measure.above is None):
            add((*path, "below"), "one of below and above is needed", wanted="the threshold")
        beside = measure.against is None and any(pair.over is None for pair in pairs)
        if measure.relation in ("ratio", "difference") and beside:
            text = f"{measure.relation}, but some pairs have one controller and there is no other condition"
            add((*path, "as"), text, wanted="pairs of two, or against")
        if measure.against is not None and measure.relation not in ("ratio", "difference"):
            add((*path, "against"), f"has no effect with as: {measure.relation}", at="key")
        if measure.floor is not None and measure.relation != "ratio":
            add((*path, "floor"), f"has no effect with as: {measure.relation}", at="key")
        counts = measure.counts
        sided = isinstance(counts, dict) and len(counts) == 1 and next(iter(counts)) in ("above", "below")
        number = sided and isinstance(next(iter(counts.values())), int | float)
        if (measure.relation == "share") != (counts is not None) or (counts is not None and not number):
            add((*path, "counts"), got=shown(counts), wanted="{above: 0} or {below: 0} with as: share, else nothing")
        if measure.against is not None:
            self._levels((*path, "against"), measure.against, one=True)

    def _levels(self, path: KeyPath, raw: Any, one: bool = False) -> dict[str, list[str]]:
        """Return the levels that a mapping names for each axis."""
        found: dict[str, list[str]] = {}
        if not isinstance(raw, dict):
            self.document.add(path, got=shown(raw), wanted="axis: level")
            return found
        for axis, named in raw.items():
            here = (*path, axis)
            if axis not in self.axes:
                near = nearest(axis, self.axes) or ""
                wanted = "" if near else f"one of {', '.join(self.axes)}"
                self.document.add(here, "no such axis", at="key", nearest=near, wanted=wanted)
                continue
            levels = list(self.axes[axis])
            chosen = levels if named == ALL else named if isinstance(named, list) else [named]
            for level in chosen:
                if level not in levels:
                    near = (nearest(level, levels) or "") if isinstance(level, str) else ""
                    wanted = "" if near else f"one of {', '.join(levels)}"
                    self.document.add(here, "no such level", got=shown(level), nearest=near, wanted=wanted)
            if one and len(chosen) != 1:
                self.document.add(here, got=shown(named), wanted="one level")
            found[axis] = [level for level in chosen if level in levels]
        return found

    def _conditions(self, path: KeyPath, raw: Any) -> dict[Condition, int]:
        """Return the conditions that a mapping of axes to levels stands for, or a list of such, with their draws."""
        found: dict[Condition, int] = {}
        for i, one in enumerate(raw if isinstance(raw, list) else [raw or {}]):
            here = (*path, i) if isinstance(raw, list) else path
            draws = one.get(DRAWS, self.draws) if isinstance(one, dict) else self.draws
            if type(draws) is not int or not 1 <= draws <= MAX_DRAWS:
                self.document.add((*here, DRAWS), got=shown(draws), wanted=f"a whole number, 1 to {MAX_DRAWS}")
                continue
            levels = {key: value for key, value in one.items() if key != DRAWS} if isinstance(one, dict) else one
            named = self._levels(here, levels)
            for condition in itertools.product(*(named.get(axis, list(own)[:1]) for axis, own in self.axes.items())):
                found[condition] = max(draws, found.get(condition, 0))
        return {
            condition: found[condition] for condition in itertools.product(*self.axes.values()) if condition in found
        }
