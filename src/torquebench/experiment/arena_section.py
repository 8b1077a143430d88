"""The ``arena`` section of a config: where laws are tuned and judged, with which budget, and at which chattering."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from torquebench.errors import Fault
from torquebench.experiment.conditions import check_keys
from torquebench.experiment.extends import AUTO
from torquebench.experiment.falsify_section import Claim
from torquebench.experiment.groups import ARENA, Many, Named, NameOr, group_of
from torquebench.experiment.presets import write_presets
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document
from torquebench.experiment.sweep_section import MAX_DRAWS
from torquebench.experiment.tune_section import DRAWN, MAX_EVALUATIONS
from torquebench.experiment.values import Anything, Here
from torquebench.experiment.yaml_tree import Seq, tree_of
from torquebench.keys import Key
from torquebench.laws import find_law, law_names
from torquebench.metrics import METRICS, MetricInfo
from torquebench.registry import SLUG

CHATTERING = "chattering"
_Overlays = Mapping[str, Any]


def _overlays(what: str, least: int = 1) -> Named:
    return Named(f"a mapping of names to {what}", Anything(), names=SLUG, least=least, most=32)


@dataclass(frozen=True, kw_only=True)
class Arena:
    """An arena: every law tuned alike on the training conditions, and judged on draws that no tuning saw."""

    laws: Annotated[
        Literal["all", "listed"],
        Key("Who enters: all for every law that there is, with gains: auto where no controller of the file runs it"),
    ] = "all"
    chains: Annotated[
        _Overlays,
        Key("Chains, name -> the keys that it sets, as for --set; every law is tuned and judged for each by itself"),
        _overlays("chains"),
    ]
    training: Annotated[
        _Overlays,
        Key("What tuning sees, name -> the keys that it sets on top of the chain's"),
        _overlays("training conditions"),
    ]
    burdens: Annotated[
        _Overlays,
        Key("What laws are judged under, name -> the keys that it sets on top of the chain's"),
        _overlays("burdens"),
    ]
    held_out: Annotated[
        _Overlays,
        Key("Conditions of kinds that tuning never saw, which are judged apart, name -> keys on top of the chain's"),
        _overlays("held-out conditions", least=0),
    ] = field(default_factory=dict)
    metric: Annotated[str, Key("Error that ranks"), NameOr(METRICS)] = "rmse"
    metrics: Annotated[
        tuple[str, ...],
        Key("Further metrics that are stored of every run, for another ranking without another run"),
        Many("metrics", 0, len(METRICS), NameOr(METRICS)),
    ] = ("max_error",)
    levels: Annotated[
        tuple[float, ...],
        Key("Chattering at which laws are compared, of the torque limit, rising", "1", above=0, at_most=1),
    ] = (0.005, 0.02, 0.05)
    evaluations: Annotated[
        int,
        Key(
            "Sets of gains that are tried of each law, chain and tuning seed, its own among them",
            "1",
            at_least=2,
            at_most=MAX_EVALUATIONS,
        ),
    ] = 100
    seeds: Annotated[
        int, Key("Tunings of each law and chain, which begin differently", "1", at_least=2, at_most=20)
    ] = 3
    seed: Annotated[int, Key("Source of the tunings' random numbers", "1", at_least=0, at_most=2**31)] = 0
    sampler: Annotated[Literal["nsga-ii", "random"], Key("Sampler of optuna")] = "nsga-ii"
    draws: Annotated[
        int, Key("Draws of each training condition", "1", at_least=1, at_most=1000, name="training_draws")
    ] = 1
    tests: Annotated[
        int,
        Key(
            "Draws of each burden and held-out condition in which something is random",
            "1",
            at_least=2,
            at_most=MAX_DRAWS,
            name="draws",
        ),
    ] = 30
    looks: Annotated[
        int,
        Key(
            "How often laws are compared while draws come in, the last time after all of them, each time after twice "
            "as many: gains whose pairs are all decided, or are ties whatever the draws, are run no further",
            "1",
            at_least=1,
            at_most=8,
        ),
    ] = 1

    def faults(self) -> Iterator[Fault]:
        """Yield what leaves it without meaning."""
        if any(a >= b for a, b in zip(self.levels, self.levels[1:], strict=False)):
            yield Fault(("levels",), got=", ".join(f"{x:g}" for x in self.levels), wanted="rising levels")
        if METRICS[self.metric].better == "higher" or self.metric == CHATTERING:
            yield Fault(("metric",), got=f"'{self.metric}'", wanted="an error, of which lower values are better")
        for name in self.held_out:
            if name in self.burdens:
                yield Fault(("held_out", name), "is a burden too", at="key", wanted="another name")

    @property
    def infos(self) -> tuple[MetricInfo, ...]:
        """Metrics that tuning minimises: the error, and chattering."""
        return METRICS[self.metric], METRICS[CHATTERING]

    @property
    def constraints(self) -> tuple[Claim, ...]:
        """None: a level of chattering is chosen from the front."""
        return ()

    @property
    def stored(self) -> tuple[str, ...]:
        """Metrics that are stored of every run: the error, chattering, and the others."""
        return tuple(dict.fromkeys((self.metric, CHATTERING, *self.metrics)))


def take_arena(document: Document) -> Arena:
    """Take the section out of a document, enter the laws that are not listed, and return it.

    Raises:
        ConfigError: it is missing or has mistakes; all of them at once.
    """
    if ARENA not in document.root:
        document.add((ARENA,), "missing: chains, training conditions and burdens", at="key")
    document.raise_problems()
    raw = document.root[ARENA]
    found: Arena = Here(document, group_of(Experiment)).read(group_of(Arena), ARENA, raw)
    for part in ("chains", "training", "burdens", "held_out"):
        for name, keys in (raw.get(part) or {}).items() if isinstance(raw, dict) else ():
            check_keys(document, (ARENA, part, name), keys, (ARENA,))
            for key in sorted(DRAWN & keys.keys()) if isinstance(keys, dict) else ():
                document.add((ARENA, part, name, key), "is the arena's own", at="key", wanted="none here")
    document.raise_problems()
    del document.root[ARENA]
    if found.laws == "all":
        _enter_all(document)
    document.raise_problems()
    return found


def _enter_all(document: Document) -> None:
    """Add a controller with ``gains: auto`` for each law that no controller runs and that the model has links for."""
    place = document.place((ARENA,))
    if not isinstance(document.root.get("controllers"), Seq):
        document.root.put("controllers", Seq(), place, place)
    items = document.root["controllers"]
    taken = {str(item.get(key)) for item in items if isinstance(item, dict) for key in ("law", "name")}
    model = document.root.get("model")
    structure = model.get("structure", "exact") if isinstance(model, dict) else "exact"
    for law in law_names():
        if law not in taken and not find_law(law).misfit(structure):
            items.append(tree_of({"name": law, "law": law, "gains": AUTO}, place))
            items.places.append(place)
    write_presets(document.root, document.add)
