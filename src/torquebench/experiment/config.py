"""From a config's file or text to the experiment that it describes, or to all mistakes in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from torquebench.experiment.groups import group_of
from torquebench.experiment.rules import check_rules
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, apply_overrides, read_bytes, read_document
from torquebench.experiment.values import Here


def load_experiment(path: Path | str, overrides: Sequence[str] = ()) -> Experiment:
    """Read and check an experiment's file.

    Args:
        path: The YAML file.
        overrides: Edits ``key=value`` made before the check.

    Raises:
        ConfigError: the file cannot be read, or it or an override has mistakes; all of them at once.
    """
    return parse_experiment(read_bytes(path), str(path), overrides)


def parse_experiment(text: str | bytes, filename: str = "", overrides: Sequence[str] = ()) -> Experiment:
    """Check an experiment given as YAML text.

    Args:
        text: The YAML.
        filename: What to call it in messages.
        overrides: Edits ``key=value`` made before the check.

    Raises:
        ConfigError: something in it or in an override is wrong; all mistakes at once, in reading order.
    """
    document = read_document(text, filename)
    apply_overrides(document, overrides)
    return check_experiment(document)


def check_experiment(document: Document) -> Experiment:
    """Check an experiment given as a document.

    Raises:
        ConfigError: something in it is wrong; all mistakes at once, in reading order. Sections are held against each
            other where each is right by itself.
    """
    top = group_of(Experiment)
    values = top.values(document.root, Here(document, top))
    check_rules(document, values)
    document.raise_problems()
    if values["run"].metrics_from is None:
        values["run"] = dataclasses.replace(values["run"], metrics_from=values["reference"].metrics_from)
    return Experiment(**values)
