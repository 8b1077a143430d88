"""Checks across keys: what each value alone cannot show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from torquebench.errors import did_you_mean
from torquebench.experiment.document import Document, KeyPath, shortened
from torquebench.experiment.scenario_schema import Chain, Disturbance, Friction
from torquebench.experiment.schema import (
    AnalyticPlant,
    Belief,
    ControllerKeys,
    Plant,
    QuinticReference,
    Reference,
    Run,
    Video,
    whole_steps,
)
from torquebench.experiment.sections import Checked
from torquebench.robot.library import camera_names

CLOSED_FORM_MODEL = "puma560"
MIN_WINDOW = 0.5  # s; the steady-state error is taken over this last part of a run
MAX_BYTES = 2 << 30
MAX_SUBSTEPS = 10**8
ARRAYS = 12  # (N, n) arrays of 8-byte numbers kept for each controller
FAR_OFF = 10.0  # a number this many times too large is not what its counterpart should be changed to
ABSURD = 1e15  # amounts above are not printed
LARGEST_STEP = 0.1  # s; no larger step is proposed
_RELATIVE = 1e-9  # decimal periods are not exact in binary; a real mismatch is far larger


@dataclass(frozen=True, slots=True)
class Parts:
    """The sections as far as they are valid; None where nothing could be made of one."""

    plant: Checked[Plant] | None
    model: Checked[Belief] | None
    controllers: Sequence[Checked[ControllerKeys]]
    reference: Checked[Reference] | None
    chain: Checked[Chain] | None
    """None also for a chain given by its name."""
    disturbances: Sequence[Checked[Disturbance]]
    run: Checked[Run] | None
    video: Checked[Video] | None
    n: int | None
    """Number of joints; None when the model is not known."""

    def get(self, section: str, key: str) -> Any:
        """Return a valid value, or None."""
        checked = getattr(self, section)
        return None if checked is None else checked.values.get(key)

    def given(self, section: str, key: str) -> bool:
        """Whether the config states a key itself."""
        checked = getattr(self, section)
        return checked is not None and key in checked.given


def check_across(document: Document, parts: Parts) -> None:
    """Record every contradiction between keys that are valid by themselves."""
    _check_structures(document, parts)
    _check_lengths(document, parts)
    _check_times(document, parts)
    _check_work(document, parts)
    _check_camera(document, parts)


def _check_structures(document: Document, parts: Parts) -> None:
    arm = parts.get("plant", "model")
    analytic = parts.plant is not None and parts.plant.model is AnalyticPlant
    for section in ["model"] + ["plant"] * analytic:
        structure, constants = parts.get(section, "structure"), parts.get(section, "constants")
        if structure == "exact" and constants == "printed":
            message = (
                "structure exact cannot have constants printed: the printed constants break the seven exact ties "
                "that those of a rigid body satisfy"
            )
            document.add(_first_given(parts, (section, "constants"), (section, "structure")), message)
        if arm is None or arm == CLOSED_FORM_MODEL:
            continue
        for key, value, only in (("structure", structure, "exact"), ("constants", constants, "fitted")):
            if value not in (None, only):
                message = f"got {value}, wanted {only}: model '{arm}' has no other (only {CLOSED_FORM_MODEL} has)"
                document.add((section, key), message)


def _check_lengths(document: Document, parts: Parts) -> None:
    vectors: dict[KeyPath, Any] = {("run", "initial_q"): parts.get("run", "initial_q")}
    friction = parts.get("plant", "friction")
    if isinstance(friction, Friction):
        vectors |= {("plant", "friction", key): getattr(friction, key) for key in ("viscous", "coulomb")}
    for checked in [parts.reference, *parts.disturbances]:
        vectors |= {(*checked.path, key): value for key, value in checked.values.items()} if checked else {}
    for controller in parts.controllers:
        gains = controller.values.get("gains", {})
        vectors |= {(*controller.path, "gains", key): value for key, value in gains.items()}
    for path, value in vectors.items():
        if parts.n is not None and isinstance(value, tuple) and len(value) != parts.n:
            arm = parts.get("plant", "model")
            message = f"got {len(value)} numbers, wanted one number or {parts.n}, one for each joint of '{arm}'"
            document.add(path, message)


def _check_times(document: Document, parts: Parts) -> None:
    timestep, period = parts.get("plant", "timestep"), parts.get("run", "control_period")
    duration, start = parts.get("run", "duration"), parts.get("run", "metrics_from")
    sampled = ("run", "control_period")
    written = _first_given(parts, sampled, ("plant", "timestep"))
    if not check_multiple(document, sampled, period, "plant.timestep", timestep, written):
        period = None  # what is wrong with it would only be said again
    check_multiple(document, ("run", "duration"), duration, "run.control_period", period)
    for noise in parts.disturbances:
        hold = noise.values.get("hold")
        place = sampled if "hold" not in noise.given and parts.given(*sampled) else (*noise.path, "hold")
        check_multiple(document, (*noise.path, "hold"), hold, "run.control_period", period, place)
    if duration is not None and start is not None and duration < (start + MIN_WINDOW) * (1.0 - _RELATIVE):
        shortest = f"the run must last at least {MIN_WINDOW:g} s longer, {start + MIN_WINDOW:.12g} s"
        if start > FAR_OFF * max(duration, 1.0):  # surely the start is wrong, not the run's length
            shortest = f"wanted it at least {MIN_WINDOW:g} s before the run ends"
        if parts.given("run", "metrics_from"):
            document.add(("run", "metrics_from"), f"got {start:.12g} s with run.duration {duration:.12g} s: {shortest}")
        else:
            message = f"got {duration:.12g} s, but metrics start at {start:g} s (run.metrics_from): {shortest}"
            document.add(("run", "duration"), message)
    at = parts.get("reference", "at")
    if at is not None and duration is not None and at >= duration:
        message = f"got {at:.12g} s, wanted less than run.duration, {duration:.12g} s: there would be no step"
        document.add(("reference", "at"), message)
    rise = parts.get("reference", "rise_time")
    quintic = parts.reference is not None and parts.reference.model is QuinticReference
    if quintic and None not in (rise, duration) and rise > duration * (1.0 + _RELATIVE):
        message = f"got {rise:.12g} s, wanted at most run.duration, {duration:.12g} s"
        reason = "the metrics of the motion would be measured against a target that is never reached"
        document.add(("reference", "rise_time"), f"{message}: {reason}")


def _check_work(document: Document, parts: Parts) -> None:
    timestep, period = parts.get("plant", "timestep"), parts.get("run", "control_period")
    duration, laws = parts.get("run", "duration"), max(len(parts.controllers), 1)
    if timestep is None or period is None or duration is None:
        return
    needs = [_Need("plant.timestep", min(timestep, period), MAX_SUBSTEPS / laws, 1.0, "physics steps in all")]
    if parts.n is not None:
        each = parts.n * ARRAYS * 8  # bytes a control instant takes for one controller
        needs.append(_Need("run.control_period", period, MAX_BYTES / (each * laws), each / 2**30, "GiB of memory"))
    longest = min(need.step * need.most for need in needs)
    limits = (f"at most {MAX_SUBSTEPS:.0e} are run", f"at most {MAX_BYTES >> 30} GiB are used")
    for need, limit in zip(needs, limits, strict=False):
        if duration / need.step <= need.most:
            continue
        amount = duration / need.step * need.size * laws
        shown = f"{amount:.3g}" if amount < ABSURD else "far too many"
        # Each proposal must help by itself, and be one to make.
        cures = [f"lower run.duration to at most {longest:.5g} s"] * (longest >= MIN_WINDOW * (1.0 - _RELATIVE))
        cures += [f"raise {need.step_key}"] * (duration / need.most <= LARGEST_STEP)
        cures += ["fewer controllers"] * (laws > 1 and duration / need.step <= need.most * laws)
        *others, last = cures or [f"run.duration is too long for such a {need.step_key}"]
        cure = f"{', '.join(others)}, or {last}" if others else last
        document.add(("run", "duration"), f"needs {shown} {need.unit}, {limit}: {cure}")


def _check_camera(document: Document, parts: Parts) -> None:
    camera, arm = parts.get("video", "camera"), parts.get("plant", "model")
    if camera is not None and arm is not None and camera not in (names := camera_names(arm)):
        document.add(("video", "camera"), f"'{arm}' has no camera {shortened(camera)}{did_you_mean(camera, names)}")


class _Need(NamedTuple):
    """Something of which a run takes some at each step, and of which there is a limit."""

    step_key: str
    step: float
    """Length of a step [s]."""
    most: float
    """Number of steps within the limit."""
    size: float
    """What one step of one controller takes, in `unit`."""
    unit: str


def check_multiple(
    document: Document,
    path: KeyPath,
    value: float | None,
    unit_key: str,
    unit: float | None,
    place: KeyPath = (),
) -> bool:
    """Record, and return False, when a time is not a whole number, at least 1, of another.

    Args:
        document: Receives the mistake.
        path: Key of the time.
        value: The time [s]; None when it is not known.
        unit_key, unit: The other time, likewise.
        place: Key that was written, when that is another than `path`.
    """
    if value is None or unit is None or not math.isfinite(value / unit):
        return True
    steps = max(whole_steps(value, unit), 1)
    if abs(value / unit - steps) <= _RELATIVE * steps:
        return True
    message = f"got {value:.12g} s, wanted a whole multiple of {unit_key}, {unit:.12g} s"
    nearest = f"; the nearest is {steps * unit:.12g}"
    if unit > FAR_OFF * value:  # surely the unit is wrong, not the value
        nearest = f"; {unit_key} must not be longer than that"
    document.add(path, message + nearest, place=document.place(place or path))
    return False


def _first_given(parts: Parts, *paths: tuple[str, str]) -> tuple[str, str]:
    """Return the first of the keys that the config states itself; the others have their defaults."""
    return next((path for path in paths if parts.given(*path)), paths[0])
