"""The link parameters realise the paper's tables, and are a possible arm."""

import re
import subprocess
import sys

import numpy as np
import pytest
import yaml

from torquebench import Puma560
from torquebench.robot.library import data_root, model_folder
from torquebench.robot.links import pseudo_inertia
from torquebench.robot.puma560.constants import read_constants
from torquebench.robot.puma560.symbols import CONSTANTS

FOLDER = model_folder("puma560")


@pytest.fixture(scope="module")
def misfit():
    """Misfit of each of the 34 constants in its own tolerance."""
    table, _ = read_constants(FOLDER / "constants.yaml")
    arm = Puma560()
    achieved = np.array([arm.constant(name) for name in CONSTANTS])
    return dict(zip(CONSTANTS, (achieved - table.value) / table.tolerance, strict=True))


def test_chi2_is_the_optimum_over_the_ties(misfit):
    """chi2 <= 0.00212: 0.00211 is the least-squares optimum a rigid arm can reach, rounded up in the last digit."""
    assert sum(m * m for m in misfit.values()) <= 0.00212


def test_worst_misfit(misfit):
    """No constant is off by more than 0.025 of its tolerance; the worst at the optimum is I22."""
    worst = max(misfit, key=lambda name: abs(misfit[name]))
    assert worst == "I22"
    assert abs(misfit[worst]) <= 0.025


def test_motor_inertias_are_met_exactly(misfit):
    """Armatures are free parameters, so Im1..Im6 have no misfit at all."""
    assert [misfit[f"Im{i}"] for i in range(1, 7)] == [0.0] * 6


@pytest.mark.parametrize(
    ("x", "y", "factor"),
    [
        ("g2", "I5", "-g/a2"),
        ("g4", "I12", "-g/a2"),
        ("I15", "I16", "d4/a2"),
        ("I18", "I16", "d/a2"),
        ("I22", "I16", "a3/a2"),
        ("g5", "I16", "-g/a2"),
    ],
)
def test_ties_hold_exactly_in_the_fit_and_to_rounding_in_print(x, y, factor):
    """Six of the seven ties are proportions; a rigid arm has them exactly, the print to 1 %."""
    a2, a3, d, d4, _ = Puma560().geometry
    ratio = {"-g/a2": -9.81 / a2, "d4/a2": d4 / a2, "d/a2": d / a2, "a3/a2": a3 / a2}[factor]
    for arm, tolerance in ((Puma560(), 1e-9), (Puma560("corrected", "printed"), 0.01)):
        assert arm.constant(x) == pytest.approx(ratio * arm.constant(y), rel=tolerance)


def test_seventh_tie():
    """I19 + I20 + I21 = 0 for every arm of this form; in the table 2e-6, within its last printed digits (1e-4)."""
    assert sum(Puma560().constant(name) for name in ("I19", "I20", "I21")) == pytest.approx(0, abs=1e-14)
    assert sum(Puma560("corrected", "printed").constant(n) for n in ("I19", "I20", "I21")) == pytest.approx(0, abs=1e-4)


def test_every_link_is_a_possible_body():
    """Every pseudo-inertia is positive definite: the link is some distribution of positive mass."""
    flat = Puma560().flat
    for mass, com, inertia in zip(flat.mass, flat.com, flat.inertia, strict=True):
        assert np.linalg.eigvalsh(pseudo_inertia(mass, com, inertia))[0] > 0


def test_constants_file_holds_every_constant_with_its_provenance():
    """34 constants, each with value, tolerance, unit, table and equation; six DH rows."""
    data = yaml.safe_load((FOLDER / "constants.yaml").read_text())
    entries = data["inertial"] | data["motor"] | data["gravitational"]
    assert tuple(entries) == CONSTANTS
    for name, entry in entries.items():
        assert set(entry) == {"value", "tolerance", "unit", "table", "equation"}, name
        assert entry["tolerance"] > 0
        assert entry["table"] == (4 if name.startswith("g") else 3)
        assert re.fullmatch(r"\(\d\d\)", entry["equation"])
    assert [row["joint"] for row in data["dh"]["rows"]] == [1, 2, 3, 4, 5, 6]


def test_generated_files_are_current_and_a_stale_one_is_noticed(tmp_path):
    """--check passes on the committed files and fails when one inertia in either moves by 1e-6 relative."""
    script = data_root() / "scripts" / "fit_puma560.py"
    copy = tmp_path / "models" / "puma560"
    copy.mkdir(parents=True)
    for file in FOLDER.iterdir():
        (copy / file.name).write_bytes(file.read_bytes())

    def check():
        return subprocess.run(
            [sys.executable, script, "--check"],
            env={"TORQUEBENCH_DATA": str(tmp_path), "PATH": "/usr/bin"},
            capture_output=True,
            text=True,
            check=False,
        )

    fresh = check()
    assert fresh.returncode == 0, fresh.stdout + fresh.stderr
    for name in ("links.yaml", "puma560.xml"):
        original = (copy / name).read_text()
        moved = original.replace("0.541371946147", "0.541372487519")
        assert moved != original
        (copy / name).write_text(moved)
        stale = check()
        assert stale.returncode == 1
        assert name in stale.stdout
        (copy / name).write_text(original)
