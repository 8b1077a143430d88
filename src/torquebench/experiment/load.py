"""Reading an experiment: every mistake in the file and the overrides is reported, or none is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torquebench.laws  # noqa: F401  (registers the built-in laws)
from torquebench.errors import ModelError
from torquebench.experiment import schema
from torquebench.experiment.checks import Parts, check_across
from torquebench.experiment.controllers import build_controller, check_controllers
from torquebench.experiment.document import BROKEN, Document, KeyPath
from torquebench.experiment.fuzzy_checks import check_fuzzy
from torquebench.experiment.overrides import apply_overrides
from torquebench.experiment.scenario_checks import check_chain, check_mismatch, check_scenario
from torquebench.experiment.scenario_schema import AnyDisturbance, BandLimitedNoise, Bias, Chain, Disturbance, Sinusoid
from torquebench.experiment.sections import (
    Checked,
    Handler,
    M,
    as_mapping,
    check_fields,
    check_tagged,
    check_value,
)
from torquebench.experiment.values import shown
from torquebench.experiment.yaml_source import read_bytes, read_document
from torquebench.robot.library import model_folder

_PLANTS: Mapping[str, type[schema.Plant]] = {"mujoco": schema.MujocoPlant, "analytic": schema.AnalyticPlant}
_REFERENCES: Mapping[str, type[schema.Reference]] = {
    "sine": schema.SineReference,
    "step": schema.StepReference,
    "ramp": schema.RampReference,
    "quintic": schema.QuinticReference,
}
_DISTURBANCES: Mapping[str, type[Disturbance]] = {
    "band-limited-noise": BandLimitedNoise,
    "bias": Bias,
    "sinusoid": Sinusoid,
}


def load_experiment(path: Path, overrides: Sequence[str] = ()) -> schema.Experiment:
    """Read and check an experiment's file.

    Args:
        path: The YAML file.
        overrides: Edits ``key=value`` made before the check.

    Raises:
        ConfigError: the file cannot be read, or it or an override has mistakes; all of them at once.
    """
    return parse_experiment(read_bytes(path), str(path), overrides)


def parse_experiment(text: str | bytes, filename: str, overrides: Sequence[str] = ()) -> schema.Experiment:
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


def check_experiment(document: Document) -> schema.Experiment:
    """Check an experiment given as a document.

    Raises:
        ConfigError: something in it is wrong; all mistakes at once, in reading order.
    """
    reader = _Reader(document)
    top = reader.read()
    document.raise_problems()
    return reader.build(top)


class _Reader:
    """Checks the sections of one document, each by itself, then against each other."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._joints: int | None = None
        self._metrics_from = schema.AnyReference.metrics_from

    def read(self) -> dict[str, Any]:
        """Return the checked sections by name; mistakes are recorded in the document."""
        handlers: dict[str, Handler] = {
            "plant": self._plant,
            "model": self._model,
            "controllers": lambda path, raw: check_controllers(self._document, path, raw),
            "fuzzy": lambda path, raw: check_fuzzy(self._document, path, raw),
            "reference": self._reference,
            "chain": lambda path, raw: check_chain(self._document, path, raw, _home),
            "disturbances": self._disturbances,
            "run": self._run,
            "video": self._video,
        }
        raw = {"model": {}, "fuzzy": {}, "disturbances": [], **self._document.root}
        top = check_fields(self._document, (), raw, schema.Experiment, handlers, elsewhere=_elsewhere)
        parts = Parts(
            plant=top.get("plant"),
            model=top.get("model"),
            controllers=top.get("controllers", []),
            reference=top.get("reference"),
            chain=top["chain"] if isinstance(top.get("chain"), Checked) else None,
            disturbances=top.get("disturbances", []),
            run=top.get("run"),
            video=top.get("video"),
            n=self._joints,
        )
        check_across(self._document, parts)
        check_scenario(self._document, parts)
        return top

    def build(self, top: Mapping[str, Any]) -> schema.Experiment:
        """Return the experiment; only when no mistakes were found."""
        sections = {key: value.build() if isinstance(value, Checked) else value for key, value in top.items()}
        sections["controllers"] = tuple(build_controller(controller) for controller in top["controllers"])
        sections["fuzzy"] = {name: system.build() for name, system in top["fuzzy"].items()}
        sections["disturbances"] = tuple(disturbance.build() for disturbance in top["disturbances"])
        return schema.Experiment(**sections)

    def _plant(self, path: KeyPath, raw: Any) -> Checked[schema.Plant] | None:
        handlers = {"model": self._arm}
        return check_tagged(self._document, path, raw, "engine", schema.AnyPlant, _PLANTS, handlers, elsewhere=_home)

    def _arm(self, path: KeyPath, raw: Any) -> Any:
        name = check_value(self._document, path, raw, schema.AnyPlant, "model")
        if name is BROKEN:
            return BROKEN
        try:
            model_folder(name)
            self._joints = schema.joint_count(name)
        except ModelError as error:
            self._document.add(path, " ".join(str(error).split()))
            return BROKEN
        return name

    def _model(self, path: KeyPath, raw: Any) -> Checked[schema.Belief] | None:
        handlers = {"mismatch": lambda here, value: check_mismatch(self._document, here, value)}
        return self._section(path, raw, schema.Belief, {}, handlers)

    def _reference(self, path: KeyPath, raw: Any) -> Checked[schema.Reference] | None:
        checked = check_tagged(self._document, path, raw, "kind", schema.AnyReference, _REFERENCES, elsewhere=_home)
        if checked is not None and checked.model is not None:
            self._metrics_from = checked.model.metrics_from
        return checked

    def _disturbances(self, path: KeyPath, raw: Any) -> list[Checked[Disturbance]]:
        if not isinstance(raw, list):
            self._document.add(path, f"got {shown(raw)}, wanted a list of disturbances, [] for none")
            return []
        if len(raw) > schema.MAX_DISTURBANCES:
            self._document.add(path, f"got {len(raw)} disturbances, wanted at most {schema.MAX_DISTURBANCES}")
        base, kinds = AnyDisturbance, _DISTURBANCES
        items = enumerate(raw[: schema.MAX_DISTURBANCES])
        found = [check_tagged(self._document, (*path, i), item, "kind", base, kinds) for i, item in items]
        return [checked for checked in found if checked is not None]

    def _run(self, path: KeyPath, raw: Any) -> Checked[schema.Run] | None:
        return self._section(path, raw, schema.Run, {"metrics_from": self._metrics_from})

    def _video(self, path: KeyPath, raw: Any) -> Checked[schema.Video] | None:
        return self._section(path, raw, schema.Video, {})

    def _section(
        self,
        path: KeyPath,
        raw: Any,
        model: type[M],
        defaults: Mapping[str, Any],
        handlers: Mapping[str, Handler] | None = None,
    ) -> Checked[M] | None:
        mapping = as_mapping(self._document, path, raw, f"a mapping ({', '.join(model.model_fields)})")
        if mapping is None:
            return None
        values = check_fields(self._document, path, mapping, model, handlers, elsewhere=_home, defaults=defaults)
        return Checked(path, model, values, frozenset(mapping))


def _homes() -> dict[str, str]:
    """Return the section of each key that only one section has."""
    sections = {
        "plant": _PLANTS.values(),
        "model": [schema.Belief],
        "reference": _REFERENCES.values(),
        "chain": [Chain],
        "disturbances": _DISTURBANCES.values(),
        "run": [schema.Run],
        "video": [schema.Video],
        "the top level": [schema.Experiment],
    }
    homes: dict[str, set[str]] = {}
    for section, models in sections.items():
        for key in {key for model in models for key in model.model_fields}:
            homes.setdefault(key, set()).add(section)
    return {key: found.pop() for key, found in homes.items() if len(found) == 1}


_HOMES = _homes()


SWEEP = "sweep"


def _elsewhere(key: str) -> str | None:
    if key == SWEEP:
        return (
            "is for many runs: wanted torquebench sweep FILE, or one of its runs by torquebench run --from-sweep DIR "
            "--index K"
        )
    return _home(key)


def _home(key: str) -> str | None:
    return f"does not belong here, but in {_HOMES[key]}" if key in _HOMES else None
