"""Prints digests of what the kernels compute, as JSON; run once compiled and once interpreted, they must be the same.

``python -m tests.kernel_bytes``, with NUMBA_DISABLE_JIT=1 for the interpreted side.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from tests.arms import pack
from tests.sampled import simulate_sampled
from torquebench import AnalyticPlant, Puma560, find_law, law_names
from torquebench.check import LawCalls
from torquebench.fuzzy import Functions, builtin_system, prepare
from torquebench.fuzzy.inference import fill_activations
from torquebench.kernel import Array
from torquebench.references import Reference, Sine
from torquebench.robot import RobotModel, dynamics
from torquebench.sim.closed_loop import COMPLETED
from torquebench.sim.interpreted import Call

JIT = os.environ.get("NUMBA_DISABLE_JIT") != "1"
STRUCTURES = {
    "exact": lambda: Puma560(),
    "corrected": lambda: Puma560("corrected", "printed"),
    "printed": lambda: Puma560("printed", "printed"),
}
TARGET = Sine(np.array([1.2, -1.0, 1.0, 1.0, 1.0, 1.0]), np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0]))
GAINS = {
    "lam": 10.0,
    "k": 0.3,
    "phi": 0.3,
    "kv": 20.0,
    "ki": 50.0,
    "kf": 0.2,
    "gd": 2.0,
    "ge": 0.2,
    "gi": 0.1,
    "gds": 50.0,
    "gis": 0.1,
    "kis": 50.0,
    "k1": 10.0,
    "k2": 50.0,
    "boost": 0.4,
    "forget": 1.0,
    "gamma": 100.0,
    "kp": 300.0,
    "kd": 30.0,
    "viscous": 5.0,
    "coulomb": 4.0,
    "speed": 0.5,
    "most": 12.0,
    "least": 0.05,
    "omega": 60.0,
    "eps": 2.0,
    "mu": 0.05,
    "kr": 0.2,
    "knee": 0.05,
    "fast": 0.7,
    "rho": 0.1,
    "rho_end": 0.03,
    "shrink": 5.0,
    "rho_s": 3.0,
    "wo": 80.0,
    "m": 0.8,
    "error": 0.02,
    "rate": 2.0,
    "bound": 1.5,
}


def digest(arrays: Iterable[Array]) -> str:
    """Return the SHA-256 of the bytes of arrays."""
    h = hashlib.sha256()
    for array in arrays:
        h.update(np.ascontiguousarray(array).tobytes())
    return h.hexdigest()


def states(count: int) -> list[Array]:
    """Return positions, velocities, accelerations and torques, each (count, 6)."""
    rng = np.random.default_rng(11)
    return [scale * rng.normal(size=(count, 6)) for scale in (1.5, 2.0, 5.0, 40.0)]


def terms(model: RobotModel) -> dict[str, str]:
    """Digest of each term of the dynamics at fifty states."""
    q, qd, qdd, tau = states(50)
    return {
        "mass matrix": digest([model.mass_matrix(q)]),
        "bias": digest([model.bias_forces(q, qd), model.gravity(q)]),
        "products": digest([model.coriolis(q[:5]), model.centrifugal(q[:5])]),
        "inverse": digest([model.inverse_dynamics(q, qd, qdd)]),
        "forward": digest([model.forward_dynamics(q, qd, tau)]),
        "pose": digest([model.forward_kinematics(q)]),
    }


def law_torques(name: str) -> str:
    """Digest of a law's torque and memory over thirty states, each choice of options; compiled as runs have it."""
    law = find_law(name)
    q, qd, qdd, _ = states(30)
    # half of the states are close to the motion, so that bands are met from the inside too
    near, turn = (np.arange(30) % 2)[:, None], (np.arange(30) % 3)[:, None]
    desired = Reference(q + 0.02 * qd * near, qd + 0.05 * turn, qdd)
    results = []
    for choice in range(max([2, *(len(option.values) for option in law.options.values())])):
        options = {key: option.values[choice % len(option.values)] for key, option in law.options.items()}
        gains = {key: GAINS[key] for key, gain in law.gains.items() if gain.acts(options)}
        calls = LawCalls(law, law.pack_gains(6, gains, options), "puma560", desired, q, qd)
        assert (calls.compiled() if JIT else interpret(calls)) == COMPLETED
        results += [calls.setup.job.record_tau_law, calls.setup.job.record_memory]
    return digest(results)


def interpret(calls: LawCalls) -> int:
    """Call a law at each instant of a job, as `LawCalls.compiled` does; return COMPLETED, or a status that was not."""
    setup, job = calls.setup, calls.setup.job
    call, worst = Call(setup.law, setup.gains, setup.belief, setup.memory), COMPLETED
    for k in range(len(job.q_ref)):
        job.measured_q[:], job.measured_qd[:] = job.record_q[k], job.record_qd[k]
        status, _ = call.at(job, k)
        worst = worst if status == COMPLETED else status
        job.record_memory[:, k] = job.memory
    return worst


def fuzzy_outputs() -> dict[str, str]:
    """Digest of what each way of evaluating a fuzzy system gives at two hundred inputs, and of how its rules fire."""
    x, y = np.random.default_rng(12).uniform(-1.1, 1.1, (2, 200))
    base = builtin_system("pd-49")
    holes = replace(base, rules=base.rules[:20] + base.rules[23:])
    functions = Functions.of({name: (0.3 * k, 0.1 * k, -0.2) for k, name in enumerate(base.inputs[0].names)})
    systems = {
        "staircase": base,
        "product": replace(base, conjunction="product"),
        "any table": holes,
        "sum": replace(holes, aggregation="sum-min"),
        "functions": replace(base, output=functions),
        "tabulated": replace(builtin_system("pd-9"), aggregation="max-bounded-product"),
    }
    found = {}
    for name, system in systems.items():
        prepared = prepare(system)
        fired = np.zeros((len(x), *prepared.fis.rules.shape))
        for i in range(len(x)):
            fill_activations(prepared.fis, x[i], y[i], fired[i])
        found[f"fuzzy {name}"] = digest([prepared.outputs(x, y), fired])
    return found


def closed_loop(name: str, law: str, throw: float = 0.0) -> str:
    """Digest of 0.3 s of a law on the analytic plant; with `throw`, of a run that a disturbance ends at step 20."""
    plant, belief = STRUCTURES[name](), STRUCTURES["corrected"]()
    plain = {key: option.values[0] for key, option in find_law(law).options.items()}
    gains = {key: GAINS[key] for key, gain in find_law(law).gains.items() if gain.acts(plain)}
    d = np.zeros((300, 6))
    d[20] = throw
    run = simulate_sampled(
        AnalyticPlant(plant), pack(law, 6, **gains), belief, TARGET, duration=0.3, disturbance=d, throw=False
    )
    return run.digest()


def main() -> None:
    """Print everything."""
    found: dict[str, str] = {"compiled": str(hasattr(dynamics.forward_dynamics, "py_func") and JIT)}
    for name, make in STRUCTURES.items():
        found |= {f"{name} {term}": value for term, value in terms(make()).items()}
    found |= {f"law {law}": law_torques(law) for law in law_names()}
    found |= fuzzy_outputs()
    for law in ("smc", "linear-band-smc"):
        found[f"loop {law}"] = closed_loop("exact", law)
    # overflows to NaN in one, and to an infinite angle, whose cosine Python refuses, in the other
    for throw in (1e300, -1.7e308):
        found[f"loop ended by {throw} N m"] = closed_loop("exact", "pd", throw)
    sys.stdout.write(json.dumps(found))


if __name__ == "__main__":
    main()
