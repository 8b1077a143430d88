"""The readable path: the loop interpreted, the law called as the Python function it is."""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from torquebench.dialect import complaints
from torquebench.kernel import Array
from torquebench.kernel.twin import on_numbers, python_numbers
from torquebench.laws import Law
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.sim.closed_loop import COMPLETED, CONTROLLER_ERROR, RAISED, closed_loop, sense
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
        start = getattr(setup.law.function, "start", None)  # of a law that runs in a process of its own
        self._call = start(setup) if start else Call(setup.law, setup.gains, setup.belief, setup.memory)
        self._loop, self._job = on_numbers(closed_loop), python_numbers(setup.job)
        self._sensed = 0
        self._see()

    def sense(self, k: int) -> None:
        """Measure at control instant k, ahead of the call that goes on from there."""
        on_numbers(sense)(self._job, k)
        self._sensed = k + 1

    def change(self) -> None:
        """Have the plant go on as the next of its arms."""
        self.setup.plant.change()  # type: ignore[attr-defined]  # only of a plant that changes
        self._see()

    def __call__(self, first: int, last: int) -> int:
        """Run control instants `first` .. `last` - 1."""
        return int(self._loop(self._job, first, last, self._law, self._step, self._sensed))

    def _law(self, job: Job, k: int) -> int:
        status, self.detail = self._call.at(job, k)
        return status

    def _step(self, job: Job, substeps: int, varying: int) -> None:
        plant, own = self.setup.plant, self.setup.job
        plant.step(own.torque if varying else own.torque[0], substeps)
        self._see()

    def _see(self) -> None:
        plant, own = self.setup.plant, self.setup.job
        own.q[:], own.qd[:] = plant.state()
        if len(own.motors) > 0:
            own.motors[:] = plant.motors()  # type: ignore[attr-defined]  # only of a plant that has them


MATH_ERROR = re.compile(r"math domain error|expected a (\w+ input|number in range)")
"""Text of `math`'s domain errors, up to Python 3.13 and from 3.14 on."""


class Call:
    """A law as the Python function it is, with what it computes with, ready to be called.

    A law that returns an array instead of filling `tau` is accepted too. A law in the dialect computes with Python's
    own numbers, which divide by zero as its compiled form does, by raising; any other computes with numpy's. So does
    what it calls of this package: kernels as plain Python, of which nothing is compiled.

    Args:
        law: The law.
        gains, belief, memory: What it computes with; see `Law`.
    """

    def __init__(self, law: Law, gains: Any, belief: Model, memory: Any) -> None:
        self._in_dialect = not complaints(law)
        self._function: Callable[..., Any] = on_numbers(law.function) if self._in_dialect else law.function
        self._given = (gains, belief, memory)
        if self._in_dialect:
            self._given = (python_numbers(gains), python_numbers(belief), python_numbers(memory))

    def __call__(self, t: float, q: Array, qd: Array, ref: Reference) -> tuple[Array, int, str]:
        """Return a torque (n,) [N m], how the call went, and what went wrong.

        How it went is COMPLETED (the torque may still not be finite), RAISED or CONTROLLER_ERROR; see `closed_loop`.

        Args:
            t: Time [s].
            q, qd: Measured position [rad] and velocity [rad/s], (n,).
            ref: Desired motion at this instant.
        """
        tau = np.full(len(q), np.nan)  # so that a joint the law forgets is noticed
        status, detail = self._fill(tau, t, q, qd, ref)
        return tau, status, detail

    def at(self, job: Job, k: int) -> tuple[int, str]:
        """Call the law at control instant k of a loop, write down its torque, and return how that went."""
        seen = (job.measured_q, job.measured_qd, job.q_ref[k], job.qd_ref[k], job.qdd_ref[k])
        if not self._in_dialect:  # one that is writes to nothing of these
            seen = tuple(map(np.array, seen))  # type: ignore[assignment]
        return self._fill(job.record_tau_law[k], k * job.control_period, seen[0], seen[1], Reference(*seen[2:]))

    def _fill(self, tau: Array, t: float, q: Array, qd: Array, ref: Reference) -> tuple[int, str]:
        """Fill `tau` (n,), NaN so far; arguments as of a call."""
        gains, belief, memory = self._given
        try:
            if self._in_dialect:
                self._function(
                    gains,
                    belief,
                    t,
                    python_numbers(q),
                    python_numbers(qd),
                    python_numbers(ref),
                    memory,
                    python_numbers(tau),
                )
                return COMPLETED, ""
            with np.errstate(all="ignore"):
                returned = self._function(gains, belief, t, q, qd, ref, memory, own := np.full(len(q), np.nan))
                if returned is not None:
                    values = np.asarray(returned)
                    if values.dtype.kind not in "iuf" or np.ma.is_masked(returned):
                        return CONTROLLER_ERROR, f"the law returned {values.dtype} values, wanted real numbers"
                    own = np.array(values, dtype=np.float64)
        except (Exception, SystemExit, GeneratorExit) as error:  # noqa: BLE001  a user's law may raise anything; the run reports it
            # a law in the dialect raises nothing itself: a ValueError there is one of `math`
            domain = isinstance(error, ValueError) and (self._in_dialect or MATH_ERROR.match(_text(error)) is not None)
            raised = isinstance(error, ArithmeticError) or domain
            return RAISED if raised else CONTROLLER_ERROR, told(error)
        for name, array in {"torque": own, **memory._asdict()}.items():
            if np.shape(array) != (len(tau),) and name != "nothing":
                return CONTROLLER_ERROR, f"the law's {name} has shape {np.shape(array)}, wanted {(len(tau),)}"
        np.copyto(tau, own)
        return COMPLETED, ""


def replay(setup: Setup) -> tuple[int, str]:
    """Return how the call went at which a compiled law raised, and what was wrong, from calling it interpreted.

    Compiled code only knows that something was raised. The call is made again with the memory of the instant before.

    Args:
        setup: A run that has ended as RAISED; memory and its record become those of the interpreted call.
    """
    job, k = setup.job, int(setup.job.at[0])
    job.memory[...] = job.record_memory[:, k - 1] if k > 0 else 0.0
    status, detail = Call(setup.law, setup.gains, setup.belief, setup.memory).at(job, k)
    job.record_memory[:, k] = job.memory
    if status == COMPLETED:
        return RAISED, "the compiled law raised where the interpreted one did not"
    return status, detail


def told(error: BaseException) -> str:
    """Return what went wrong and the line of the law's file where it did."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {_text(error)} ({Path(frame.filename).name}, line {frame.lineno})"


def _text(error: BaseException) -> str:
    """Return an exception's text in one printable line; making it may fail as well."""
    try:
        return "".join(c if c.isprintable() else " " for c in str(error))
    except (Exception, SystemExit, GeneratorExit):  # noqa: BLE001
        return "(no text)"
