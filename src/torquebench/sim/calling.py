"""One call of a law: whatever it raises, returns or leaves out becomes an outcome with a reason."""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from torquebench.kernel import Array
from torquebench.laws import Law
from torquebench.references import Reference
from torquebench.robot.model import Model
from torquebench.sim.trajectory import Outcome

MATH_ERROR = re.compile(r"math domain error|expected a (\w+ input|number in range)")
"""What `math` says of an argument outside a function's domain, up to Python 3.13 and from 3.14 on."""


def call_law(
    law: Law, gains: Any, belief: Model, t: float, q: Array, qd: Array, ref: Reference, memory: Any
) -> tuple[Array, Outcome, str]:
    """Call a law once and return its torque (n,) [N m], how that went, and what went wrong.

    A law that returns an array instead of filling `tau` is accepted too.

    Args:
        law: The law.
        gains, belief, memory: What it computes with; see `Law`.
        t: Time [s].
        q, qd: Measured position [rad] and velocity [rad/s], (n,).
        ref: Desired motion at this instant.
    """
    n = len(q)
    tau = np.full(n, np.nan)  # so that a joint the law forgets is noticed
    function: Callable[..., Any] = law.function
    try:
        with np.errstate(all="ignore"):
            returned = function(gains, belief, t, q, qd, ref, memory, tau)
            if returned is not None:
                values = np.asarray(returned)
                if values.dtype.kind not in "iuf" or np.ma.is_masked(returned):
                    wrong = f"the law returned {values.dtype} values, wanted real numbers"
                    return np.full(n, np.nan), Outcome.CONTROLLER_ERROR, wrong
                tau = np.array(values, dtype=np.float64)
    except (Exception, SystemExit, GeneratorExit) as error:  # noqa: BLE001  a user's law may raise anything; the run reports it
        domain = isinstance(error, ValueError) and MATH_ERROR.match(_text(error)) is not None
        arithmetic = isinstance(error, ArithmeticError) or domain
        return np.full(n, np.nan), Outcome.BAD_TORQUE if arithmetic else Outcome.CONTROLLER_ERROR, _describe(error)
    for name, array in {"torque": tau, **memory._asdict()}.items():
        if np.shape(array) != (n,) and name != "nothing":
            wrong = f"the law's {name} has shape {np.shape(array)}, wanted {(n,)}"
            return np.full(n, np.nan), Outcome.CONTROLLER_ERROR, wrong
    if not np.all(np.isfinite(tau)):
        joint = int(np.argmin(np.isfinite(tau)))
        why = " (not written by the law, or not a number)" if np.isnan(tau[joint]) else ""
        return tau, Outcome.BAD_TORQUE, f"joint {joint + 1}: tau = {tau[joint]}{why}"
    return tau, Outcome.COMPLETED, ""


def _describe(error: BaseException) -> str:
    """Return what went wrong and the line of the law's file where it did."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {_text(error)} ({Path(frame.filename).name}, line {frame.lineno})"


def _text(error: BaseException) -> str:
    """Return an exception's text in one printable line; making it may fail as well."""
    try:
        return "".join(c if c.isprintable() else " " for c in str(error))
    except (Exception, SystemExit, GeneratorExit):  # noqa: BLE001
        return "(no text)"
