"""The readable path: the loop interpreted, the law called as the Python function it is."""

from __future__ import annotations

import copy
import dataclasses
import re
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from torquebench.dialect import complaints
from torquebench.kernel import Array
from torquebench.kernel.struct import Structure
from torquebench.laws import Law
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.sim.closed_loop import COMPLETED, CONTROLLER_ERROR, RAISED, closed_loop
from torquebench.sim.job import Job, Setup


class PythonRun:
    """A run on the readable path: call it with a range of control instants to get how they ended.

    Args:
        setup: The run.
    """

    longest = 1
    """Control instants to ask for at once."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.detail = ""
        """Reason of a failure; empty if there was none."""
        setup.job.q[:], setup.job.qd[:] = setup.plant.state()

    def attach(self) -> None:
        """Have the plant go on with its payload."""
        self.setup.plant.attach()  # type: ignore[attr-defined]  # only of a plant with a payload

    def __call__(self, first: int, last: int) -> int:
        """Run control instants `first` .. `last` - 1."""
        return closed_loop(self.setup.job, first, last, self._law, self._step)

    def _law(self, job: Job, k: int) -> int:
        s = self.setup
        ref = Reference(job.q_ref[k].copy(), job.qd_ref[k].copy(), job.qdd_ref[k].copy())
        tau, status, self.detail = call_law(
            s.law,
            s.gains,
            s.belief,
            k * job.control_period,
            job.measured_q.copy(),
            job.measured_qd.copy(),
            ref,
            s.memory,
        )
        if status == COMPLETED:
            job.record_tau_law[k] = tau
        return status

    def _step(self, job: Job, substeps: int, varying: int) -> None:
        plant = self.setup.plant
        plant.step(job.torque if varying else job.torque[0], substeps)
        job.q[:], job.qd[:] = plant.state()


MATH_ERROR = re.compile(r"math domain error|expected a (\w+ input|number in range)")
"""Text of `math`'s domain errors, up to Python 3.13 and from 3.14 on."""


def call_law(
    law: Law, gains: Any, belief: Model, t: float, q: Array, qd: Array, ref: Reference, memory: Any
) -> tuple[Array, int, str]:
    """Call a law once and return its torque (n,) [N m], how that went, and what went wrong.

    A law that returns an array instead of filling `tau` is accepted too. How it went is COMPLETED (the torque may
    still not be finite), RAISED or CONTROLLER_ERROR; see `closed_loop`. A law in the dialect computes with Python's own
    numbers, which divide by zero as its compiled form does, by raising; any other computes with numpy's.

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
    in_dialect = not complaints(law)
    given: tuple[Any, ...] = (gains, belief, t, q, qd, ref, memory, tau)
    if in_dialect:
        given = tuple(map(python_numbers, given))
    try:
        with np.errstate(all="ignore"):
            returned = function(*given)
            if returned is not None:
                values = np.asarray(returned)
                if values.dtype.kind not in "iuf" or np.ma.is_masked(returned):
                    return tau, CONTROLLER_ERROR, f"the law returned {values.dtype} values, wanted real numbers"
                tau = np.array(values, dtype=np.float64)
    except (Exception, SystemExit, GeneratorExit) as error:  # noqa: BLE001  a user's law may raise anything; the run reports it
        # a law in the dialect raises nothing itself: a ValueError there is one of `math`
        domain = isinstance(error, ValueError) and (in_dialect or MATH_ERROR.match(_text(error)) is not None)
        return tau, RAISED if isinstance(error, ArithmeticError) or domain else CONTROLLER_ERROR, _describe(error)
    for name, array in {"torque": tau, **memory._asdict()}.items():
        if np.shape(array) != (n,) and name != "nothing":
            return tau, CONTROLLER_ERROR, f"the law's {name} has shape {np.shape(array)}, wanted {(n,)}"
    return tau, COMPLETED, ""


def replay(setup: Setup) -> tuple[int, str]:
    """Return how the call went at which a compiled law raised, and what was wrong, from calling it interpreted.

    Compiled code only knows that something was raised. The call is made again with the memory of the instant before.

    Args:
        setup: A run that has ended as RAISED; memory and its record become those of the interpreted call.
    """
    job, k = setup.job, int(setup.job.at[0])
    job.memory[...] = job.record_memory[:, k - 1] if k > 0 else 0.0
    ref = Reference(job.q_ref[k].copy(), job.qd_ref[k].copy(), job.qdd_ref[k].copy())
    _, status, detail = call_law(
        setup.law,
        setup.gains,
        setup.belief,
        k * job.control_period,
        job.measured_q.copy(),
        job.measured_qd.copy(),
        ref,
        setup.memory,
    )
    job.record_memory[:, k] = job.memory
    if status == COMPLETED:
        return RAISED, "the compiled law raised where the interpreted one did not"
    return status, detail


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


class Vector(np.ndarray[Any, Any]):
    """A vector of Python's numbers."""

    __slots__ = ()
    __getitem__ = np.ndarray.item  # type: ignore[assignment]


class Matrix(np.ndarray[Any, Any]):
    """An array of more dimensions; its rows are vectors of Python's numbers."""

    __slots__ = ()

    def __getitem__(self, key: Any) -> Any:
        """Return an element as a number, or a part as an array of the same manner."""
        return python_numbers(np.ndarray.__getitem__(self, key))


def python_numbers(value: Any) -> Any:
    """Return an array, or a structure of arrays, as views whose elements read as Python numbers."""
    kind = type(value)
    if kind is np.ndarray:
        return value.view(Vector if value.ndim == 1 else Matrix)
    if kind is float or kind is int:
        return value
    if isinstance(value, Structure):
        return _structure(value)
    if isinstance(value, np.ndarray):
        return value.view(Vector if value.ndim == 1 else Matrix)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return kind(*[python_numbers(field) for field in value])
    return value


def _structure(value: Structure) -> Structure:
    """Convert a structure, which takes its time; it keeps the result, because a run has the same one at every call."""
    kept: Structure | None = vars(value).get("_python_numbers")
    if kept is None:
        kept = copy.copy(value)  # of the same words: the arrays are the same memory
        for field in dataclasses.fields(value):
            object.__setattr__(kept, field.name, python_numbers(getattr(value, field.name)))
        object.__setattr__(value, "_python_numbers", kept)
    return kept
