"""The file of a new law, to begin from, and a test of it: both hold as they are."""

from __future__ import annotations

from pathlib import Path

from torquebench.errors import ConfigError, Problem
from torquebench.laws.law import LAWS
from torquebench.registry import SLUG

LAW = '''"""{title}: what it is for, and where it is from (author, journal, year, equation)."""

from typing import Annotated, NamedTuple

from torquebench import Array, Gain, controller, gravity, sat


class Gains(NamedTuple):
    lam: Annotated[Array, Gain("slope of s = de + lambda e", "1/s", search=(2.0, 50.0, "log"))]
    k: Annotated[Array, Gain("largest correction over torque limit", "1", search=(0.05, 1.0, "log"))]
    phi: Annotated[Array, Gain("half-width of the band", "rad/s", search=(0.05, 5.0, "log"))]


class Memory(NamedTuple):
    s: Array  # the only state; a field called s is recorded as the sliding variable


@controller("{name}", gains=Gains, memory=Memory)
def law(gains, model, t, q, qd, ref, memory, tau):
    """tau = g^ + k tau_max sat(s/phi), s = de + lambda e."""
    gravity(model, q, tau)
    for i in range(len(tau)):
        memory.s[i] = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        tau[i] += gains.k[i] * model.tau_max[i] * sat(memory.s[i] / gains.phi[i])
'''
TEST = '''"""{title} keeps the contract of a law, and holds an arm against its weight."""

from pathlib import Path

import numpy as np
import torquebench as tb

tb.load_plugin(Path(__file__).with_name("{file}.py"))


def test_the_contract_holds():
    """What `torquebench check {file}.py` tries, all of it."""
    report = tb.check_law("{name}")
    assert report.held, report


def test_it_follows_a_sine():
    """With gains chosen for the arm the error stays below 50 mrad; write here what your law promises."""
    experiment = tb.load_experiment(
        {{
            "name": "{name}",
            "plant": {{"engine": "mujoco", "model": "puma560"}},
            "model": {{"structure": "corrected", "constants": "printed"}},
            "controllers": [{{"name": "mine", "law": "{name}", "gains": "auto"}}],
            "reference": {{"kind": "sine", "amplitude": 0.5, "frequency_hz": 0.5}},
            "run": {{"duration": 2.0}},
        }}
    )
    run = tb.run_experiment(experiment).trajectories["mine"]
    assert run.completed
    assert np.abs(run.q_ref - run.q).max() < 0.05
'''


def new_law(name: str, folder: str | Path = ".") -> tuple[Path, Path]:
    """Write the file of a new law and a test of it, and return their paths.

    Args:
        name: Its name in configs, lower-case letters, digits and ``-``; the files have ``_`` instead.
        folder: Where to write them.

    Raises:
        ConfigError: the name is none or is taken, or a file or the folder is in the way; nothing is written then.
    """
    problems = []
    if not SLUG.fullmatch(name):
        problems.append(Problem("NAME", got=f"'{name}'", wanted="lower-case letters, digits and '-', at most 64"))
    elif name in LAWS:
        problems.append(Problem("NAME", text=f"a law named '{name}' ships with the package", wanted="another name"))
    file = name.replace("-", "_")
    paths = Path(folder) / f"{file}.py", Path(folder) / f"test_{file}.py"
    if not Path(folder).is_dir():
        problems.append(Problem("--out", text=f"{folder} is not a folder"))
    wanted = f"a name of which no file is in {Path(folder).resolve()}, or another folder by --out"
    problems += [Problem("NAME", text=f"{path} exists", wanted=wanted) for path in paths if path.exists()]
    if problems:
        raise ConfigError(problems)
    for path, text in zip(paths, (LAW, TEST), strict=True):
        with path.open("x", encoding="utf-8") as stream:
            stream.write(text.format(name=name, file=file, title=name.replace("-", " ").capitalize()))
    return paths
