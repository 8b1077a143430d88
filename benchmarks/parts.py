"""Parts of the loop by themselves: the lean step and the fuzzy inference."""

from __future__ import annotations

import dataclasses

import numba
import numpy as np

from benchmarks.loops import PERIOD, trial_of
from benchmarks.timing import Case
from torquebench import Array, Fis, MujocoPlant, infer
from torquebench.errors import ResultError
from torquebench.kernel.struct import Structure
from torquebench.sim.plants.mujoco_native import STEP, Stepped

STEPS = 10_000
CALLS = 20_000


@dataclasses.dataclass(frozen=True, eq=False)
class System(Structure):
    """A fuzzy system as compiled code receives it."""

    fis: Fis


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def infer_all(system: System, inputs: Array, outputs: Array, calls: int) -> None:
    """Evaluate `system` for six joints, `calls` times, at the rows of `inputs` (N, 2, 6); `outputs` (6,) adds up."""
    for k in range(calls):
        row = inputs[k % len(inputs)]
        for i in range(6):
            outputs[i] += infer(system.fis, row[0, i], row[1, i])


def parts() -> list[Case]:
    """Return the lean step beside ``mj_step``, both driven from compiled code, and the inference of six joints."""
    cases = []
    for integrator in ("euler", "rk4"):
        plant = MujocoPlant("puma560", PERIOD, integrator)
        lean = plant.native().structure
        if not (isinstance(lean, Stepped) and lean.lean):
            raise ResultError("the lean step is not in use here, so there is nothing to compare")
        whole = dataclasses.replace(lean, lean=False)
        step, torque = STEP.call, np.zeros((3, 6))
        for name, arm, against in (
            (f"mj-step-{integrator}", whole, ""),
            (f"lean-step-{integrator}", lean, f"mj-step-{integrator}"),
        ):

            def run(arm=arm, plant=plant, step=step, torque=torque) -> None:  # type: ignore[no-untyped-def]
                plant.reset(np.zeros(6), np.zeros(6))
                step(arm.address, torque.ctypes.data, STEPS, 0)

            cases.append(Case(name, run, STEPS, against, note="one physics step called from compiled code"))
    system = System(trial_of(1.0).controller.gains.fis)
    inputs, outputs = np.random.default_rng(0).uniform(-1.0, 1.0, (1000, 2, 6)), np.zeros(6)
    cases.append(
        Case(
            "fuzzy-inference-six-joints",
            lambda: infer_all(system, inputs, outputs, CALLS),
            CALLS,
            unit="calls/s",
            note="exact 49-rule inference, six joints a call",
        )
    )
    return cases
