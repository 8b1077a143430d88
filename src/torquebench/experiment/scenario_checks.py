"""Checking what a law has to cope with: sensors and actuators, and the times at which things act."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, get_args

import numpy as np
from pydantic import Field

from torquebench.errors import did_you_mean
from torquebench.experiment.checks import CLOSED_FORM_MODEL, Parts, check_multiple
from torquebench.experiment.document import BROKEN, Document, KeyPath
from torquebench.experiment.keys import Keys
from torquebench.experiment.scenario_schema import Chain, ChainName, Factor, Friction, Mismatch, Payload, Sinusoid
from torquebench.experiment.sections import Checked, as_mapping, check_fields, check_value
from torquebench.experiment.values import shown
from torquebench.robot.puma560.symbols import CONSTANTS

CHAINS = get_args(ChainName)


def check_chain(document: Document, path: KeyPath, raw: Any, elsewhere: Callable[[str], str | None]) -> Any:
    """Return a chain's name, what could be made of one given key by key, or BROKEN.

    Args:
        document: Receives mistakes.
        path: Where the chain is.
        raw: What is written there.
        elsewhere: Explains a key that is valid, but not here.
    """
    if isinstance(raw, dict):
        return Checked(path, Chain, check_fields(document, path, raw, Chain, elsewhere=elsewhere), frozenset(raw))
    if isinstance(raw, str) and raw in CHAINS:
        return raw
    near = did_you_mean(raw, CHAINS) if isinstance(raw, str) else ""
    hint = near if "did you mean" in near else ""
    wanted = f"one of {', '.join(CHAINS)}, or a mapping ({', '.join(Chain.model_fields)})"
    document.add(path, f"got {shown(raw)}, wanted {wanted}{hint}")
    return BROKEN


def check_mismatch(document: Document, path: KeyPath, raw: Any) -> Any:
    """Return the model's errors, or BROKEN."""
    ways = tuple(Mismatch.model_fields)
    mapping = as_mapping(document, path, raw, f"a mapping with one of {', '.join(ways)}")
    if mapping is None:
        return BROKEN
    values = check_fields(
        document, path, mapping, Mismatch, {"constants": lambda here, value: _check_constants(document, here, value)}
    )
    given = [key for key in ways if key in mapping]
    if not mapping:
        document.add(path, f"missing: one of {', '.join(ways)}", at="key")
    for key in given[1:]:
        document.add((*path, key), f"{given[0]} is given already: wanted one of the two", at="key")
    complete = len(given) == 1 and set(ways) <= values.keys()
    return Mismatch(**values) if complete else BROKEN


class _Factor(Keys):
    value: Factor = Field(description="Factor [1].")


def _check_constants(document: Document, path: KeyPath, raw: Any) -> Any:
    mapping = as_mapping(document, path, raw, "a mapping of constants to factors, such as {g1: 1.3}")
    if mapping is None:
        return BROKEN
    if not mapping:
        document.add(path, "no constant is given: wanted at least one, such as g1: 1.3")
    found = {}
    for name, value in mapping.items():
        if name not in CONSTANTS:
            document.add((*path, name), f"unknown constant{did_you_mean(name, CONSTANTS)}", at="key")
        elif value is None:
            document.add((*path, name), "nothing is given, wanted a factor [1]")
        elif value is not BROKEN:
            found[name] = check_value(document, (*path, name), value, _Factor, "value")
    return found if len(found) == len(mapping) > 0 and BROKEN not in found.values() else BROKEN


def check_scenario(document: Document, parts: Parts) -> None:
    """Record every contradiction between keys of a scenario that are valid by themselves."""
    _check_chain(document, parts)
    _check_payload(document, parts)
    _check_errors(document, parts)
    friction = parts.get("plant", "friction")
    if isinstance(friction, Friction) and not np.any(friction.viscous) and not np.any(friction.coulomb):
        document.add(("plant", "friction"), "neither viscous nor coulomb is given: without friction leave it out")
    for disturbance in parts.disturbances:
        if disturbance.model is Sinusoid:
            _check_sinusoid(document, parts, disturbance)


def _check_chain(document: Document, parts: Parts) -> None:
    chain = parts.chain
    if chain is None:
        return
    if chain.values.get("velocity") == "exact" and chain.values.get("velocity_filter") is not None:
        message = "has no effect with velocity: exact (it belongs to velocity: differentiated)"
        document.add((*chain.path, "velocity_filter"), message, at="key")
    _check_instant(document, parts, (*chain.path, "delay"), chain.values.get("delay"))


def _check_payload(document: Document, parts: Parts) -> None:
    payload = parts.get("plant", "payload")
    if not isinstance(payload, Payload):
        return
    _check_instant(document, parts, ("plant", "payload", "at"), payload.at)
    if any(payload.offset) and parts.get("plant", "structure") in ("corrected", "printed"):
        message = "structures corrected and printed hold a payload at the wrist centre only: wanted [0, 0, 0]"
        document.add(("plant", "payload", "offset"), message)


def _check_errors(document: Document, parts: Parts) -> None:
    """Record changes of model and plant that their structures do not have."""
    mismatch, arm = parts.get("model", "mismatch"), parts.get("plant", "model")
    if isinstance(mismatch, Mismatch):
        for key in ("tolerance", "constants"):
            if getattr(mismatch, key) is None:
                continue
            path = ("model", "mismatch", key)
            if arm not in (None, CLOSED_FORM_MODEL):
                document.add(path, f"model '{arm}' has no table of constants (only {CLOSED_FORM_MODEL} has)", at="key")
            elif key == "constants" and parts.get("model", "structure") == "exact":
                message = "needs structure corrected or printed: exact has links, no constants"
                document.add(path, message, at="key")
    if parts.get("plant", "perturb") is not None and parts.get("plant", "structure") in ("corrected", "printed"):
        message = "needs structure exact: it changes links, and corrected and printed have constants"
        document.add(("plant", "perturb"), message, at="key")


def _check_instant(document: Document, parts: Parts, path: KeyPath, time: float | None) -> None:
    """Record when a time that is not zero is not one of a control instant of the run."""
    duration = parts.get("run", "duration")
    if not time:
        return
    whole = check_multiple(document, path, time, "run.control_period", parts.get("run", "control_period"))
    if whole and duration is not None and time >= duration:
        document.add(path, f"got {time:.12g} s, wanted less than run.duration, {duration:.12g} s")


def _check_sinusoid(document: Document, parts: Parts, sinusoid: Checked[Any]) -> None:
    sizes = [key for key in ("amplitude", "rms") if key in sinusoid.given]
    misspelt = not {"amplitude", "rms"} <= sinusoid.values.keys()
    if not sizes and not misspelt:
        document.add(sinusoid.path, "missing: amplitude, or rms (size of the sinusoid [N m])")
    elif len(sizes) == 2:
        document.add((*sinusoid.path, "rms"), "amplitude is given already: wanted one of the two", at="key")
    period, frequency = parts.get("run", "control_period"), sinusoid.values.get("frequency_hz")
    if period is None or frequency is None:
        return
    highest = max(frequency) if isinstance(frequency, tuple) else frequency
    if highest >= 0.5 / period:
        path = (*sinusoid.path, "frequency_hz")
        given = "frequency_hz" in sinusoid.given
        place = document.place(path if given else ("run", "control_period"))
        message = f"got {highest:g} Hz, wanted less than half of 1/run.control_period, {0.5 / period:g} Hz"
        document.add(path, message, place=place)
