"""The ``falsify`` section of a config: what may happen to the laws, what is claimed of them, and for how many runs."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

from torquebench.errors import Fault, nearest
from torquebench.experiment.config import read_sections
from torquebench.experiment.groups import FALSIFY, NameOr, group_of
from torquebench.experiment.presets import keys_of_name
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, assign
from torquebench.experiment.sweep_section import Varied, expanded, indexed, refused
from torquebench.experiment.units import units_of, without_unit
from torquebench.experiment.values import Here, Node
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import BROKEN, NUMBER, Place
from torquebench.keys import Key
from torquebench.metrics import METRICS, MetricInfo

MAX_EVALUATIONS = 1_000_000
MAX_SEEDS = 100
LIMITS: dict[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    "<": operator.lt,
    ">=": operator.ge,
    ">": operator.gt,
}
"""What a claim may say of a metric."""
OPPOSITE = {"<=": ">", "<": ">=", ">=": "<", ">": "<="}
PURE = ("", "1")
"""Units of pure numbers."""
_CLAIM = re.compile(r"\s*([A-Za-z0-9_]+)\s*(<=|>=|<|>)\s*([^\s=].*)")


class Claim(NamedTuple):
    """A claim about a metric of every run: ``max_error <= 5 mrad``."""

    metric: str
    sign: str
    """One of `LIMITS`."""
    limit: float
    """In SI units."""

    @property
    def info(self) -> MetricInfo:
        """The metric."""
        return METRICS[self.metric]

    @property
    def text(self) -> str:
        """The claim as in a config, in the unit of tables."""
        return f"{self.metric} {self.sign} {in_unit(self.info.scale * self.limit, self.info.shown_unit)}"

    @property
    def stated(self) -> str:
        """The claim in full, its limit in the metric's own unit."""
        return f"{self.metric} {self.sign} {self.limit!r}" + f" {self.info.unit}" * (self.info.unit not in PURE)

    def holds(self, value: float) -> bool:
        """Whether a value of the metric meets the claim; NaN does not."""
        return LIMITS[self.sign](value, self.limit)


def read_claim(raw: Any, denied: bool = False) -> Claim | dict[str, Any]:
    """Return a claim, or what is wrong with its text: the parts of a mistake.

    Args:
        raw: A metric, a comparison and a number with its unit.
        denied: Whether it says what is claimed not to happen.
    """
    example = "what breaks it, such as max_error > 5 mrad" if denied else ClaimText.wanted
    found = parts_of_claim(raw, example)
    if isinstance(found, dict):
        return found
    metric, sign, text = found
    info = METRICS[metric]
    limit = _limit(info, text.strip())
    if not math.isfinite(limit):
        names = dict.fromkeys(filter(None, (info.shown_unit.removeprefix("1"), *units_of(info.unit))))
        with_unit = "" if info.shown_unit in PURE else " with its unit"
        return {"got": f"'{text}'", "wanted": f"a number{with_unit}" + (f" [{', '.join(names)}]" if names else "")}
    upward = sign in (">", ">=")
    if (upward != (info.better == "higher")) != denied:
        wrong = f"is what {metric} ought to be" if denied else f"claims that {metric} is bad"
        return {"text": wrong, "got": sign, "wanted": f"{OPPOSITE[sign]}: of {metric} {info.better} values are better"}
    return Claim(metric, OPPOSITE[sign] if denied else sign, limit)


def _limit(info: MetricInfo, text: str) -> float:
    """Return a metric's limit in SI units, NaN where the text is none: what tables show with a unit needs one, or is 0.

    Args:
        info: The metric.
        text: A number, with a unit of the metric's dimension or the one that tables have.
    """
    limit, shown_limit = without_unit(text, info.unit), without_unit(text, info.shown_unit)
    if isinstance(limit, float):
        return limit
    if isinstance(shown_limit, float):
        return shown_limit / info.scale
    bare = float(text) if NUMBER.fullmatch(text) else math.nan
    return bare if bare == 0.0 or info.shown_unit in PURE else math.nan


def parts_of_claim(raw: Any, wanted: str) -> tuple[str, str, str] | dict[str, Any]:
    """Return the metric, the comparison and the number of a claim's text, or what is wrong with it.

    Args:
        raw: The text.
        wanted: What would be right, for the mistake.
    """
    found = _CLAIM.fullmatch(raw) if isinstance(raw, str) else None
    if found is None:
        return {"got": shown(raw), "wanted": wanted}
    metric, sign, text = found.groups()
    if metric in METRICS:
        return metric, sign, text
    near = nearest(metric, tuple(METRICS)) or ""
    return {
        "text": "no such metric",
        "got": f"'{metric}'",
        "nearest": near,
        "wanted": "" if near else ", ".join(METRICS),
    }


class ClaimText(Node):
    """A claim: a metric, a comparison and a number with its unit."""

    wanted = "a claim such as max_error <= 5 mrad"

    def read(self, raw: Any, here: Here) -> Any:
        """Return the claim."""
        found = read_claim(raw)
        if isinstance(found, Claim):
            return found
        here.add(**found)
        return BROKEN

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return str


def in_unit(value: float, unit: str) -> str:
    """Return a number with its unit, in four digits."""
    return f"{value:.4g}" if unit in PURE else f"{value:.4g} {unit}"


@dataclass(frozen=True)
class Bounds:
    """Least and greatest value of a number."""

    low: Annotated[float, Key("Least value; its unit is the key's", "1")]
    high: Annotated[float, Key("Greatest value, likewise", "1")]
    spacing: Annotated[Literal["linear", "log"], Key("Whether equal steps or equal ratios count the same")] = "linear"
    step: Annotated[
        float | None,
        Key(
            "Values are whole multiples of it; if left out, run.control_period for a key that takes whole multiples of "
            "that, and else none",
            "1",
            above=0,
        ),
    ] = None

    def faults(self) -> Iterator[Fault]:
        """Yield what leaves it without meaning."""
        if not self.low < self.high:
            yield Fault((), got=f"{self.low:g} and {self.high:g}", wanted="the smaller number first")
        elif self.spacing == "log" and self.low <= 0.0:
            yield Fault(("low",), got=f"{self.low:g}", wanted="more than 0 with spacing log")


class Span(Node):
    """Least and greatest value: two numbers, or a mapping."""

    wanted = "the least and the greatest value, as [0, 3] or {low: 0, high: 3}"

    def read(self, raw: Any, here: Here) -> Any:
        """Return the bounds."""
        if isinstance(raw, dict):
            return group_of(Bounds).read(raw, here)
        pair = raw if isinstance(raw, list) and len(raw) == 2 else [None]
        if not all(isinstance(x, int | float) and not isinstance(x, bool) for x in pair):
            here.add(got=shown(raw), wanted=self.wanted)
            return BROKEN
        bounds = Bounds(float(raw[0]), float(raw[1]))
        faults = list(bounds.faults())
        for fault in faults:
            here.document.add_fault(fault._replace(path=()), here.path)
        return BROKEN if faults else bounds

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return tuple[float, float] | group_of(Bounds).type()


class Allowed(NamedTuple):
    """A key that the search may change."""

    key: str
    place: Place
    bounds: Bounds


@dataclass(frozen=True)
class Falsify:
    """A search for what breaks the laws: each law's own worst case within stated bounds."""

    variables: Annotated[
        tuple[Allowed, ...],
        Key(
            "Key -> the least and the greatest value that it may have: [0, 3], or {low: 0, high: 3}; keys as for "
            "--set. Of a key that holds a list each number is searched by itself; one alone is run.initial_q[0]"
        ),
        Varied(Span(), Allowed),
    ]
    metric: Annotated[str | None, Key("Metric to make as bad as can be; max_error if left out"), NameOr(METRICS)] = None
    claim: Annotated[
        Claim | None,
        Key(
            "What is claimed of every run, such as max_error <= 5 mrad: the search of a law ends at the first run that "
            "breaks it, and one that fails does; if left out, it looks for the worst"
        ),
        ClaimText(),
    ] = None
    evaluations: Annotated[int, Key("Runs of each law, method and seed", "1", at_least=1, at_most=MAX_EVALUATIONS)] = (
        300
    )
    seeds: Annotated[
        int, Key("Searches by each method, which begin differently", "1", at_least=1, at_most=MAX_SEEDS)
    ] = 1
    seed: Annotated[int, Key("Source of the searches' random numbers", "1", at_least=0, at_most=2**31)] = 0

    def faults(self) -> Iterator[Fault]:
        """Yield what leaves it without meaning."""
        if not self.variables:
            yield Fault(("variables",), "nothing may change", wanted="keys, such as plant.payload.mass: [0, 3]")
        if self.claim is not None and self.metric is not None and self.metric != self.claim.metric:
            yield Fault(("metric",), f"the claim is about {self.claim.metric}", wanted="that, or none")

    @property
    def info(self) -> MetricInfo:
        """The metric that is made worse."""
        return METRICS[self.claim.metric if self.claim else self.metric or "max_error"]


def spell_chain(document: Document, keys: Iterable[str]) -> None:
    """Write a chain that is given by its name, and of which a key may change, as its keys.

    Args:
        document: The config.
        keys: The keys that may change.
    """
    name, place = document.root.get("chain", "ideal"), document.place(("chain",))
    inside = isinstance(name, str) and any(key.startswith("chain.") for key in keys)
    known = keys_of_name(("chain",), name, place) if inside else None
    if known is not None:
        assign(document, ["chain"], known, place, place)


def take_falsify(document: Document) -> Falsify:
    """Take the section out of a document and return it.

    Raises:
        ConfigError: it is missing, a key that may change is none, or either has mistakes; all of them at once, and with
            them those of the other sections.
    """
    found, places = Falsify(()), dict[str, Place]()
    if FALSIFY in document.root:
        section = document.root[FALSIFY]
        found = Here(document, group_of(Experiment)).read(group_of(Falsify), FALSIFY, section)
        variables = section.get("variables") if isinstance(section, dict) else None
        for key in variables if isinstance(variables, dict) else ():
            if refused(key) is None:
                places[key] = document.place((FALSIFY, "variables", key), "key")
        del document.root[FALSIFY]
    else:
        text = "missing: what may happen, such as {variables: {plant.payload.mass: [0, 3]}}"
        document.add((FALSIFY,), text, at="key")
    _check_others(document, places)
    document.raise_problems()
    return found


def _check_others(document: Document, places: Mapping[str, Place]) -> None:
    """Record the mistakes of the other sections, and the keys that are none.

    Args:
        document: The config without its section.
        places: The keys that may change, each with its place.
    """
    probe = document.copy()
    spell_chain(probe, places)
    for key, place in places.items():
        targets = expanded(probe, key)
        if not targets:
            probe.add((FALSIFY, "variables", key), "no controller's law has it", place=place)
        for path in [indexed(probe.root, parts) for parts in targets]:
            if not probe.written(path):
                assign(probe, path, BROKEN, place, place)  # its name is checked, and no value
    read_sections(probe)
    document.found += [found for found in dict.fromkeys(probe.found) if found not in document.found]
    document.unchecked, document.full = probe.unchecked, document.full or probe.full
