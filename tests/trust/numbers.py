"""Numbers against other sources: closed forms, three implementations, tests that must fail, one process for long."""

from __future__ import annotations

import ast
import gc
import math
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from trust.rows import Unavailable, row
from trust.workshop import EXPERIMENT, Workshop

from torquebench.metrics import from_joints, per_joint
from torquebench.shipped import data_root
from torquebench.sim.trajectory import Trajectory

PERIOD = 0.001


@row(
    "closed-forms",
    "Metrics of signals with known figures are those figures, to round-off or to what sampling leaves open.",
    ci=40,
    release=2000,
)
def attack_metrics(shop: Workshop, tries: int) -> Iterator[str]:
    """Sines of random amplitude, of whole periods in the window, as error and torque, some of it above the limit.

    Sums over whole periods are exact but for round-off. Where a figure is that of a continuous signal (total
    variation, IAE), sampling makes it smaller by at most pi^2/(2 m^2), m samples to a period.
    """
    for _ in range(tries):
        m, turns = shop.random.randrange(20, 90), shop.random.randrange(40, 60)
        a, b, limit = (10.0 ** shop.random.uniform(-3, 3) for _ in range(3))
        n = m * turns
        t = PERIOD * np.arange(n)
        wave = np.sin(2.0 * math.pi * (np.arange(n) % m) / m)[:, None]
        tau = np.clip(b * wave, -limit, limit)
        zero = np.zeros_like(tau)
        run = Trajectory(t, -a * wave, zero, zero, zero, zero, zero, zero, zero, b * wave, tau, tau)
        conditions: dict[str, Any] = {"metrics_from": 0.0, "control_period": PERIOD, "step_like": False}
        found = from_joints(per_joint(run, tau_max=np.array([limit]), **conditions))
        slack = math.pi**2 / (2.0 * m * m)
        top = b * float(np.max(np.abs(wave)))
        wanted = {
            "rmse": (a / math.sqrt(2.0), 1e-12),
            "max_error": (a * float(np.max(np.abs(wave[:m]))), 1e-15),
            "iae": (2.0 * a / math.pi * t[-1], 2.0 * slack + 2.0 / n),
            "saturation_fraction": (float(np.mean(np.abs(b * wave) >= limit)), 0.02),
        }
        if top < limit:
            # the Hann window leaves of a whole number of periods its power, but for what leaks past the corner
            wanted["chattering"] = (100.0 * b / math.sqrt(2.0) / limit, 2e-3)
            wanted["effort"] = (0.5 * (b / limit) ** 2, 1e-12)
        wrong = []
        for name, (value, tolerance) in wanted.items():
            got = found[name].value
            if got is None or not abs(got - value) <= tolerance * max(abs(value), 1e-300):
                wrong.append(f"{name} {got} for {value}")
        yield (
            f"{m} samples, {turns} periods, error {a:.3g}, torque {b:.3g} of {limit:.3g}: {'; '.join(wrong)}"
            if wrong
            else ""
        )


ARMS = ("puma560", "ur5e", "fr3", "iiwa14")


@row("engines", "MuJoCo, ours and Pinocchio give the same dynamics of four arms, to 1e-12.", ci=200, release=20_000)
def attack_dynamics(shop: Workshop, tries: int) -> Iterator[str]:
    """Mass matrix and inverse dynamics at random states, relative to the largest entry; a state a try."""
    try:
        import pinocchio
    except ImportError:
        raise Unavailable("Pinocchio is not installed (pip install pin)") from None
    from torquebench.comparison import random_states
    from torquebench.robot import load_model
    from torquebench.robot.library import file_of_arm
    from torquebench.sim.plants.mujoco import MujocoModel

    for k, name in enumerate(ARMS):
        arm, file = load_model(name), file_of_arm(name).origin
        theirs, other = MujocoModel(name), pinocchio.buildModelFromMJCF(str(file))
        data = other.createData()
        count = tries // len(ARMS) + (k < tries % len(ARMS))
        states = random_states(arm.n, count, seed=shop.random.randrange(2**31))
        ours = arm.inverse_dynamics(*states)
        sides = {
            "MuJoCo": theirs.inverse_dynamics(*states),
            "Pinocchio": np.array([pinocchio.rnea(other, data, *state).copy() for state in zip(*states, strict=True)]),
        }
        masses = arm.mass_matrix(states[0])
        upper = (np.triu(pinocchio.crba(other, data, q)) for q in states[0])
        mass = {
            "MuJoCo": theirs.mass_matrix(states[0]),
            "Pinocchio": np.array([half + np.triu(half, 1).T for half in upper]),
        }
        for i in range(count):
            apart = {f"{side}, torque": _apart(ours[i], x[i]) for side, x in sides.items()}
            apart |= {f"{side}, mass": _apart(masses[i], x[i]) for side, x in mass.items()}
            worst = max(apart, key=lambda side: apart[side])
            yield f"{name}, {worst}: {apart[worst]:.1g}" if apart[worst] > 1e-12 else ""


def _apart(a: Any, b: Any) -> float:
    return float(np.max(np.abs(a - b)) / np.max(np.abs(a)))


MUTATED: dict[str, list[str]] = {
    "metrics/errors.py": ["tests/metrics/test_metrics.py"],
    "metrics/torque.py": ["tests/metrics/test_formulas.py"],
    "metrics/chattering.py": [
        "tests/metrics/test_chattering.py",
        "tests/metrics/test_formulas.py",
        "-k not slow_chain and not page and not limited_rate and not linear_law",
    ],
    "metrics/step_response.py": ["tests/metrics/test_formulas.py", "tests/metrics/test_metrics.py"],
    "statistics.py": ["tests/test_statistics.py"],
    "arena/ranking.py": ["tests/arena/test_ranking.py"],
    "robot/dynamics.py": [
        "tests/robot/test_structure.py",
        "tests/robot/test_agreement.py",
        "tests/test_certificates.py::test_coriolis_force_makes_the_energy_balance",
        "-k not wrist_moving and not torus",
    ],
    "robot/rigid_body.py": ["tests/robot/test_agreement.py"],
    "certificates.py": [
        "tests/test_certificates.py",
        "-k right_model or needed or constant_inertia or what_K_moves or evenly or outside_the or longer_than"
        " or papers_own or tenth or held_in_a_layer or too_wide or failed_run",
    ],
    "references/quintic.py": ["tests/test_references.py"],
    "references/ramp.py": ["tests/test_references.py"],
    "references/sine.py": ["tests/test_references.py"],
    "references/step.py": ["tests/test_references.py"],
    "disturbances/noise.py": ["tests/test_disturbances.py"],
    "disturbances/sinusoid.py": ["tests/test_disturbances.py"],
    "chain/sensors.py": ["tests/sim/test_sensors.py", "tests/sim/test_chain_parts.py", "-k not whole_run"],
    "chain/response.py": ["tests/sim/test_chain_response.py"],
    "sim/friction.py": [
        "tests/sim/test_friction_curves.py",
        "tests/sim/test_friction.py",
        "-k not (alike or slip or mujoco or mj_step or energy_lost or order or puma or zero)",
    ],
    "laws/parts.py": ["tests/laws/test_laws.py"],
    "laws/pd.py": ["tests/laws/test_laws.py"],
    "laws/sliding_mode.py": ["tests/laws/test_laws.py"],
    "laws/super_twisting.py": ["tests/laws/test_laws.py"],
    "laws/terminal_smc.py": ["tests/laws/test_sliding_modes.py", "-k by_hand or are_the_equations"],
    "laws/disturbance_observer.py": ["tests/laws/test_observers.py", "-k equation or observers_by_hand or first_order"],
}
"""File of the package -> the tests that must fail where it is wrong."""
SWAPPED: dict[type, type] = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
SWAPPED |= {ast.Lt: ast.GtE, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.GtE: ast.Lt}


@row(
    "mutants",
    "A sign, an operator or a comparison that is exchanged in a formula is found by the tests.",
    ci=3,
    release=200,
)
def attack_tests(shop: Workshop, tries: int) -> Iterator[str]:
    """One operator of one file of the core exchanged in a copy of the checkout; then the tests of that file.

    These tests must pass on the untouched copy: else they would find whatever is exchanged.
    """
    copy = shop.folder / "mutated"
    left_out = shutil.ignore_patterns("__pycache__", ".git", ".venv", "runs", "node_modules", "*.mp4")
    shutil.copytree(data_root(), copy, ignore=left_out)
    sound = set[str]()
    for _ in range(tries):
        name = shop.random.choice(list(MUTATED))
        file = copy / "src" / "torquebench" / name
        text = file.read_text(encoding="utf-8")
        if name not in sound and not _pass(copy, MUTATED[name]):
            raise RuntimeError(f"{', '.join(MUTATED[name])} fail as they are")
        sound.add(name)
        mutant, line = mutated(shop.random, text)
        file.write_text(mutant, encoding="utf-8")
        survived = _pass(copy, MUTATED[name])
        file.write_text(text, encoding="utf-8")
        yield f"{name}: no test minds {line}" if survived else ""


def _pass(checkout: Path, tests: list[str]) -> bool:
    """Return whether tests of a checkout pass; those that do not end are no pass."""
    words = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", *tests]
    environment = os.environ | {"PYTHONPATH": str(checkout / "src"), "TORQUEBENCH_DATA": str(checkout)}
    environment |= {"NUMBA_DISABLE_JIT": "1"}  # the same source, without a minute's compiling for each mutant
    try:
        done = subprocess.run(words, cwd=checkout, env=environment, check=False, capture_output=True, timeout=900)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def mutated(draw: random.Random, text: str) -> tuple[str, str]:
    """Return a source with one operator exchanged, and the new line with its number; what makes words is left out."""
    tree = ast.parse(text)
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and not _makes_words(node)]
    inside = [node for function in functions for statement in function.body for node in ast.walk(statement)]
    places = [node for node in inside if isinstance(node, ast.BinOp) and type(node.op) in SWAPPED]
    compared = [node for node in inside if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED]
    signs = [node for node in inside if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)]
    node = draw.choice([*places, *compared, *signs])
    if isinstance(node, ast.BinOp):
        node.op = SWAPPED[type(node.op)]()
    elif isinstance(node, ast.Compare):
        node.ops[0] = SWAPPED[type(node.ops[0])]()
    else:
        node.op = ast.UAdd()
    assert node.end_lineno is not None
    lines = text.splitlines(keepends=True)
    before = "".join(lines[: node.lineno - 1]) + lines[node.lineno - 1].encode()[: node.col_offset].decode()
    last = lines[node.end_lineno - 1].encode()[node.end_col_offset :].decode()
    after = last + "".join(lines[node.end_lineno :])
    new = ast.unparse(node)
    return f"{before}({new}){after}", f"line {node.lineno}, {new}"


def _makes_words(function: ast.FunctionDef) -> bool:
    """Return whether a function returns texts: a message is no formula."""
    return function.returns is not None and any(word in ast.unparse(function.returns) for word in ("str", "Fault"))


@row("soak", "Runs one after the other in one process do not grow it, and give the same bytes.", ci=20, release=300)
def attack_with_patience(shop: Workshop, tries: int) -> Iterator[str]:
    """The same two loops with 50 gains in turn; memory after each run against that after the first fifth."""
    from torquebench.experiment.config import parse_experiment
    from torquebench.experiment.run import run_experiment

    seen: dict[int, str] = {}
    settled = 0.0
    for number in range(tries):
        turn = number % max(1, min(50, tries // 4))
        result = run_experiment(parse_experiment(EXPERIMENT, "", [f"controllers[0].gains.lam={10 + 0.01 * turn}"]))
        digest = result.runs["pd"].digest()
        del result
        gc.collect()
        now = _resident()
        settled = now if number <= tries // 5 else settled
        found = "other bytes" if seen.setdefault(turn, digest) != digest else ""
        yield found or (f"{now - settled:.0f} MiB more after {number + 1} runs" if now > settled + 30.0 else "")


def _resident() -> float:
    """Return this process's memory [MiB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
