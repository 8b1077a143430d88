"""An arena's study, checked: for each chain the entries with their gains, what they are tuned and judged on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from torquebench.errors import ConfigError
from torquebench.experiment.arena_section import Arena, take_arena
from torquebench.experiment.conditions import set_keys
from torquebench.experiment.config import check_experiment
from torquebench.experiment.dump import dump_tree
from torquebench.experiment.groups import ARENA
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document
from torquebench.experiment.tune_section import Condition
from torquebench.keys import altered


class Track(NamedTuple):
    """One chain: laws are tuned and judged for it by themselves."""

    name: str
    base: Experiment
    """Every entry with the gains that it has before it is tuned."""
    training: tuple[Condition, ...]
    burdens: tuple[Condition, ...]
    held_out: tuple[Condition, ...]

    @property
    def tests(self) -> tuple[Condition, ...]:
        """All that entries are judged on."""
        return self.burdens + self.held_out

    def sealed(self, seed: int) -> Track:
        """Return the track whose tests are drawn from a seed of their own."""

        def drawn(conditions: tuple[Condition, ...]) -> tuple[Condition, ...]:
            return tuple(
                one._replace(experiment=altered(one.experiment, run=replace(one.experiment.run, seed=seed)))
                for one in conditions
            )

        return self._replace(burdens=drawn(self.burdens), held_out=drawn(self.held_out))


class Study(NamedTuple):
    """A config's section ``arena`` without mistakes, and the experiments that it makes."""

    name: str
    text: str
    """The config with the section, changes and what it extends included."""
    arms: Mapping[str, str]
    """Path -> text of each arm that is read from a file."""
    asked: Arena
    tracks: Mapping[str, Track]


def take_study(document: Document) -> Study:
    """Return the study that a config with the section describes.

    Raises:
        ConfigError: it has mistakes; all of them at once.
    """
    file = document.copy()
    file.found = list(document.found)
    whole = json.loads(json.dumps(document.root))
    asked = take_arena(document)
    tracks = dict[str, Track]()
    for chain, keys in asked.chains.items():
        on_chain = document.copy()
        set_keys(on_chain, keys, file, (ARENA, "chains", chain))
        base = _checked(file, on_chain)
        if base is not None:
            parts = {
                part: _conditions(file, on_chain, base, getattr(asked, part), part)
                for part in ("training", "burdens", "held_out")
            }
            tracks[chain] = Track(chain, base, **parts)
    file.found = list(dict.fromkeys(file.found))
    file.raise_problems()
    arms = {path: arm.text for path, (_, arm) in sorted(document.arms.items())}
    return Study(str(document.root["name"]), dump_tree(whole), arms, asked, tracks)


def _checked(file: Document, document: Document) -> Experiment | None:
    """Return a document's experiment; None where it has mistakes, which are recorded in the file."""
    try:
        experiment = check_experiment(document)
    except ConfigError:
        file.found += document.found
        return None
    _ = experiment.n
    return experiment


def _conditions(
    file: Document, document: Document, base: Experiment, given: Mapping[str, Any], part: str
) -> tuple[Condition, ...]:
    """Return the conditions of a part of the section, with the gains of the chain; mistakes are recorded.

    Args:
        file: The whole config.
        document: The config on the chain.
        base: Its experiment.
        given: Name -> keys.
        part: Where they stand.
    """
    found = list[Condition]()
    for name, keys in given.items():
        changed = document.copy()
        set_keys(changed, keys, file, (ARENA, part, name))
        experiment = _checked(file, changed)
        if experiment is not None and experiment.n != base.n:
            got, wanted = f"an arm of {experiment.n} joints", f"{base.n}, as the config's own has"
            file.add((ARENA, part, name), got=got, wanted=wanted)
        elif experiment is not None:
            found.append(Condition(name, altered(experiment, controllers=base.controllers)))
    return tuple(found)
