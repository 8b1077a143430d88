"""Whether everything that a law is given has an effect: each gain, each option, each joint's own motion."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from torquebench.check.cases import ARMS, Motion, arm, combinations, gains_of, label, motions
from torquebench.check.driving import drive, driver
from torquebench.check.report import Report
from torquebench.kernel import Array
from torquebench.laws import Law
from torquebench.laws.dialect import line_of

FACTORS = (1.5, 0.5, 10.0, 0.1)
"""By which a gain is multiplied to see whether it has an effect."""
Options = Mapping[str, str | bool]


def check_effects(law: Law, report: Report) -> None:
    """Check that each gain, each option and each joint's own motion changes the torque somewhere."""
    silent = {name: _silent_gain(law, name) for name in law.gains}
    wrong = [f"'{name}' {where}" for name, where in silent.items() if where]
    wrong += [f"option '{name}' makes no difference" for name in law.options if not _option_matters(law, name)]
    names = [name for name in law.gains if silent[name]]
    lines = sorted({line_of(law.gains_type, name, law.function) for name in names})
    place = f" ({Path(report.file).name}, line {', '.join(map(str, lines))})" if lines else ""
    count = f"each of {len(law.gains)} gains and {len(law.options)} options changes the torque"
    report.add("gains", "; ".join(wrong) + place if wrong else "", count)
    joints = next((text for name in ARMS for options in combinations(law) if (text := _idle(law, name, options))), "")
    place = f" ({Path(report.file).name}, line {report.line})"
    report.add("joints", joints and joints + place, "each joint's torque follows that joint's own motion")


def _torque(law: Law, name: str, options: Options, gains: Mapping[str, Array], motion: Motion) -> bytes:
    return drive(driver(law, arm(name), options, gains), motion).tau.tobytes()


def _silent_gain(law: Law, gain: str) -> str:
    """Return where a gain has no effect under any choice of options; an empty text when it has one everywhere."""
    for name in ARMS:
        n = arm(name).n
        used = [o for o in combinations(law) if law.gain_problem(gain, True, o) is None]
        silent = [j + 1 for j in range(n) if not any(_gain_matters(law, gain, j, name, o) for o in used)]
        if len(silent) == n:
            return "has no effect"
        if silent:
            return f"has no effect on {name}'s joint {', '.join(map(str, silent))}"
    return ""


def _gain_matters(law: Law, gain: str, joint: int, name: str, options: Options) -> bool:
    n = arm(name).n
    gains = gains_of(law, n, options, 1)
    for motion in list(motions(n))[::-1]:  # the lively ones first
        base = _torque(law, name, options, gains, motion)
        for factor in FACTORS:
            changed = gains[gain].copy()
            changed[joint] *= factor
            if _torque(law, name, options, gains | {gain: changed}, motion) != base:
                return True
    return False


def _option_matters(law: Law, name: str) -> bool:
    """Whether some value of an option gives another torque than its first."""
    values = law.options[name].values
    for options in combinations(law):
        if options[name] == values[0]:
            for other in values[1:]:
                changed = {**options, name: other}
                for motion in motions(2):
                    torques = [_torque(law, "two-link", o, gains_of(law, 2, o, 1), motion) for o in (options, changed)]
                    if torques[0] != torques[1]:
                        return True
    return len(values) < 2


def _idle(law: Law, name: str, options: Options) -> str:
    """Return which joint's torque does not depend on what that joint does."""
    n = arm(name).n
    gains = gains_of(law, n, options, 1)
    stretches = list(motions(n))
    driven = np.zeros(n, dtype=bool)
    for motion, other in zip(stretches[2:], list(motions(n, seed=1))[2:], strict=True):
        base = drive(driver(law, arm(name), options, gains), motion).tau
        for j in np.flatnonzero(~driven):
            changed = Motion(motion.t, *(_mixed(a, b, int(j)) for a, b in zip(motion[1:], other[1:], strict=True)))
            tau = drive(driver(law, arm(name), options, gains), changed).tau
            driven[j] = base[:, j].tobytes() != tau[:, j].tobytes()
    if np.all(driven):
        return ""
    joint = int(np.argmin(driven)) + 1
    return f"{name}{label(options)}: joint {joint}'s torque does not depend on that joint's state or reference"


def _mixed(a: Array, b: Array, joint: int) -> Any:
    """Return `a` with one joint's column of `b`."""
    mixed = a.copy()
    mixed[:, joint] = b[:, joint]
    return mixed
