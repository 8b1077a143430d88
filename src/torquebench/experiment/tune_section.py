"""The ``tune`` section of a config: what the laws are tuned for, with how many runs, and what they are judged on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple

from torquebench.errors import ConfigError, Fault
from torquebench.experiment.conditions import check_keys, set_keys
from torquebench.experiment.config import check_experiment, read_sections
from torquebench.experiment.falsify_section import Claim, ClaimText
from torquebench.experiment.groups import TUNE, Many, Named, NameOr, group_of
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document
from torquebench.experiment.values import Anything, Here
from torquebench.experiment.yaml_tree import KeyPath
from torquebench.keys import Key, altered
from torquebench.metrics import METRICS, MetricInfo
from torquebench.references.reference import depends_on_arm
from torquebench.registry import SLUG

MAX_EVALUATIONS, MAX_SEEDS, MAX_CONDITIONS = 100_000, 100, 64
HELD = 1_000_000
"""First draw that laws are judged on; those that they are tuned on come before."""
AS_IS = "as-it-is"
"""Name of the config without changes, where no conditions are given."""
CONDITIONS = "Name -> keys that it sets, as for --set; {} for the config as it is"
ONE, SOME = "a metric, or a list of two", "names of conditions, each with keys"
DRAWN = {"run.draw", "run.seed"}
"""Keys that a condition cannot set."""


class Objectives(Many):
    """A metric, or two."""

    def read(self, raw: Any, here: Here) -> Any:
        """Return the metrics, a tuple."""
        return super().read([raw] if isinstance(raw, str) else raw, here)

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return NameOr(METRICS).type() | super().type()


_CONDITIONS = Named(f"a mapping of {SOME}", Anything(), names=SLUG, least=1, most=MAX_CONDITIONS)


@dataclass(frozen=True)
class Judged:
    """What tuned laws are judged on: draws that no law was tuned on."""

    draws: Annotated[int, Key("Draws of each condition", "1", at_least=1, at_most=HELD)] = 20
    conditions: Annotated[
        Mapping[str, Any] | None, Key(f"{CONDITIONS}; those of training if left out"), _CONDITIONS
    ] = None


@dataclass(frozen=True)
class Tune:
    """Tuning of every law alike: the same number of evaluations, conditions, draws and seeds."""

    evaluations: Annotated[
        int,
        Key(
            "Sets of gains that are tried of each law and seed, its own among them; each is run in every draw of every "
            "condition",
            "1",
            at_least=2,
            at_most=MAX_EVALUATIONS,
        ),
    ] = 100
    seeds: Annotated[
        int,
        Key("Searches of each law that begin differently: their spread is shown", "1", at_least=3, at_most=MAX_SEEDS),
    ] = 3
    seed: Annotated[int, Key("Source of the searches' random numbers", "1", at_least=0, at_most=2**31)] = 0
    method: Annotated[
        Literal["random", "tpe", "cma-es", "nsga-ii"] | None,
        Key("Sampler of optuna; tpe if left out, and nsga-ii for two objectives", name="sampler"),
    ] = None
    objectives: Annotated[
        tuple[str, ...],
        Key(
            "Metric that is made small: its geometric mean over conditions and draws; of two, such as [rmse, "
            "chattering], the front is searched, and the first chooses the gains that are shown",
            name="objective",
        ),
        Objectives("metrics", 1, 2, NameOr(METRICS), ONE),
    ] = ("rmse",)
    constraints: Annotated[
        tuple[Claim, ...],
        Key("What every run must keep, such as chattering <= 5 %: gains that do not are worse than any that do"),
        Many("constraints", 0, 8, ClaimText()),
    ] = ()
    draws: Annotated[int, Key("Draws of each condition that laws are tuned on", "1", at_least=1, at_most=HELD)] = 2
    conditions: Annotated[Mapping[str, Any], Key(f"{CONDITIONS}. Every law is tuned under all"), _CONDITIONS] = field(
        default_factory=lambda: {AS_IS: {}}
    )
    test: Annotated[Judged, Key("What the tuned laws are judged on")] = Judged()

    def faults(self) -> Iterator[Fault]:
        """Yield what leaves it without meaning."""
        for i, key in enumerate(self.objectives):
            if METRICS[key].better == "higher":
                yield Fault(("objective",), got=f"'{key}'", wanted="a metric of which lower values are better")
            if key in self.objectives[:i]:
                yield Fault(("objective",), got=f"'{key}' twice", wanted="two metrics")
        claimed = [claim.metric for claim in self.constraints]
        for i, key in enumerate(claimed):
            if key in claimed[:i]:
                yield Fault(("constraints", i), f"{key} has a constraint already", wanted="one of the two")
        if len(self.objectives) > 1 and self.sampler in ("tpe", "cma-es"):
            yield Fault(("sampler",), f"{self.sampler} has one objective", wanted="nsga-ii or random for two")

    @property
    def sampler(self) -> Literal["random", "tpe", "cma-es", "nsga-ii"]:
        """The sampler of optuna."""
        return self.method or ("tpe" if len(self.objectives) == 1 else "nsga-ii")

    @property
    def infos(self) -> tuple[MetricInfo, ...]:
        """The objectives."""
        return tuple(METRICS[key] for key in self.objectives)


class Condition(NamedTuple):
    """A condition, and the experiment that it makes, with the gains of the config as it is."""

    name: str
    experiment: Experiment


class TuningStudy(NamedTuple):
    """A config's section ``tune`` without mistakes, and the experiments that it makes."""

    asked: Tune
    base: Experiment
    """The config as it is: it decides the gains, and the boxes in which they are looked for."""
    training: tuple[Condition, ...]
    judged: tuple[Condition, ...]


def take_tune(document: Document) -> TuningStudy:
    """Return the study that a config with the section describes.

    Raises:
        ConfigError: the section is missing, or it, the other sections or the experiment of a condition has mistakes;
            all of them at once.
    """
    rest = document.copy()
    rest.root.pop(TUNE, None)
    if TUNE not in document.root:
        text = "missing: what the laws are tuned for, such as {objective: rmse, evaluations: 100}"
        document.add((TUNE,), text, at="key")
    else:
        asked: Tune = Here(document, group_of(Experiment)).read(group_of(Tune), TUNE, document.root[TUNE])
    probe = rest.copy()
    read_sections(probe)
    document.found += probe.found
    document.unchecked, document.full = probe.unchecked, document.full or probe.full
    document.raise_problems()
    base = check_experiment(rest.copy())
    training = _conditions(document, rest, asked, asked.conditions, (TUNE, "conditions"), base)
    judged, held = training, (TUNE, "test", "conditions")
    if asked.test.conditions is not None:
        judged = _conditions(document, rest, asked, asked.test.conditions, held, base)
    for condition in judged:
        known = [other.experiment for other in training]
        if not condition.experiment.is_drawn and condition.experiment in known:
            text = f"nothing is random in '{condition.name}': to judge laws on it is to judge them on what tuned them"
            document.add(held, text, wanted="conditions that training does not have, or something random in them")
    document.raise_problems()
    return TuningStudy(asked, base, training, judged)


def _conditions(
    document: Document, rest: Document, asked: Tune, given: Mapping[str, Any], path: KeyPath, base: Experiment
) -> tuple[Condition, ...]:
    """Return conditions; mistakes are recorded in the document.

    Args:
        document: The config.
        rest: The config without the section.
        asked: The section.
        given: Name -> keys.
        path: Where they stand.
        base: The config as it is.
    """
    found = list[Condition]()
    for name, keys in given.items():
        here, before = (*path, name), len(document.found)
        check_keys(document, here, keys, (TUNE,))
        for key, value in keys.items() if isinstance(keys, dict) else ():
            inside = {f"{key}.{inner}" for inner in value} if isinstance(value, dict) else {key}
            if inside & DRAWN:
                text = "keeps the draws that laws are tuned on from those that they are judged on"
                document.add((*here, key), text, at="key", wanted="none here")
        if len(document.found) > before:
            continue
        changed = rest.copy()
        set_keys(changed, keys, document, here)
        try:
            experiment = check_experiment(changed)
        except ConfigError:
            document.found += changed.found
            continue
        if experiment.n != base.n:
            document.add(here, got=f"an arm of {experiment.n} joints", wanted=f"{base.n}, as the config's own has")
            continue
        for info in asked.infos:
            step, tool = experiment.reference.is_step_like, depends_on_arm(experiment.reference)
            if (info.steps_only and not step) or (info.of_tool and not tool):
                document.add(here, f"has no {info.key}", wanted="a reference that has it, or another objective")
        found.append(Condition(name, altered(experiment, controllers=base.controllers)))
    return tuple(found)
