"""Stored runs: what goes into the file comes out of it, and a damaged file is an error, never a wrong run."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.arms import pack, pendulum, still
from tests.sampled import simulate_sampled
from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.trajectory import SIGNALS, Outcome, Trajectory, load_trajectory


def short_run(disturbance: float = 0.0) -> Trajectory:
    """Return 20 ms of a PID run, whose integral is an extra channel; it fails at step 9 when `disturbance` is huge."""
    arm, d = pendulum(), np.zeros((20, 1))
    d[9] = disturbance
    return simulate_sampled(
        AnalyticPlant(arm),
        pack("pid", 1, lam=10, kv=20, ki=50),
        arm,
        still(np.array([0.3])),
        duration=0.02,
        disturbance=d,
        throw=False,
    )


RUNS = [pytest.param(0.0, id="completed"), pytest.param(1e9, id="failed")]


@pytest.mark.parametrize("disturbance", RUNS)
def test_round_trip(disturbance: float, tmp_path: Path) -> None:
    """Every array to the byte, the outcome, the failing step, the detail and the extra channels come back."""
    run = short_run(disturbance)
    (tmp_path / "t.npz").write_bytes(run.to_bytes())
    back = load_trajectory(tmp_path / "t.npz")
    assert back.digest() == run.digest()
    assert (back.outcome, back.failed_at, back.detail) == (run.outcome, run.failed_at, run.detail)
    assert back.failed_at == (9 if disturbance else None)
    assert list(back.arrays()) == list(run.arrays()) == ["t", *SIGNALS, "memory_integral"]
    for name, value in run.arrays().items():
        assert back.arrays()[name].tobytes() == value.tobytes()
        assert back.arrays()[name].shape == value.shape
    assert back.to_bytes() == run.to_bytes()


def test_arrays_are_read_only(tmp_path: Path) -> None:
    """What happened cannot be changed afterwards, neither in memory nor after loading."""
    run = short_run()
    (tmp_path / "t.npz").write_bytes(run.to_bytes())
    for kept in (run, load_trajectory(tmp_path / "t.npz")):
        for array in kept.arrays().values():
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0


def test_the_digest_sees_everything() -> None:
    """One bit in any array, another outcome, another failing step, an exchange of two signals: another digest."""
    run = short_run()
    digests = {run.digest()}
    changed: list[Trajectory] = []
    for name in ("t", *SIGNALS):
        array = getattr(run, name).copy()
        array.view(np.uint64)[4] ^= 1
        changed.append(replace(run, **{name: array}))
    integral = run.extra["integral"].copy()
    integral[3] += 1.0
    changed += [
        replace(run, extra={"integral": integral}),
        replace(run, extra={"other": run.extra["integral"].copy()}),
        replace(run, outcome=Outcome.DIVERGED),
        replace(run, failed_at=19),
        replace(run, q=run.qd, qd=run.q),
        replace(run, tau=run.tau[:-1].copy()),
    ]
    for other in changed:
        assert other.digest() not in digests
        digests.add(other.digest())


def test_a_torn_file_is_an_error(tmp_path: Path) -> None:
    """A file cut at any length (every 37th, and the last bytes) raises ResultError with the path, and nothing else."""
    data, file = short_run().to_bytes(), tmp_path / "torn.npz"
    for length in [*range(0, len(data), 37), *range(len(data) - 30, len(data))]:
        file.write_bytes(data[:length])
        with pytest.raises(ResultError, match=r"torn\.npz: not a readable trajectory"):
            load_trajectory(file)


def test_a_flipped_bit_in_the_numbers_is_an_error(tmp_path: Path) -> None:
    """Wherever a bit flips, the file is refused or, in a field of the archive without meaning, reads the same."""
    run, file = short_run(), tmp_path / "flipped.npz"
    data = run.to_bytes()
    directory = data.index(b"PK\x01\x02")
    refused = 0
    for place in range(0, directory, 11):
        bad = bytearray(data)
        bad[place] ^= 0x10
        file.write_bytes(bad)
        try:
            assert load_trajectory(file).digest() == run.digest()
        except ResultError:
            refused += 1
    # of a file of 21 arrays with 20 numbers each at least the numbers themselves, a third of it, are covered
    assert refused > directory // 11 // 3


def npz(**arrays: Any) -> bytes:
    """Return an NPZ file of these arrays."""
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def stored() -> dict[str, Array]:
    """Return everything that a good file has."""
    with np.load(io.BytesIO(short_run().to_bytes())) as content:
        return dict(content)


def empty_zip() -> bytes:
    """Return a ZIP archive without members."""
    buffer = io.BytesIO()
    zipfile.ZipFile(buffer, "w").close()
    return buffer.getvalue()


def pickled() -> bytes:
    """Return a good file, but with one array that only pickle could read."""
    good = stored()
    return npz(**{**good, "q": np.array([{}], dtype=object)})


@pytest.mark.parametrize("what", ["missing", "folder", "empty", "text", "one array", "no members", "pickle"])
def test_what_is_no_trajectory_is_an_error(what: str, tmp_path: Path) -> None:
    """Whatever else lies at the path is refused with the path; pickled objects are never loaded."""
    file = tmp_path / "x.npz"
    if what == "folder":
        file.mkdir()
    elif what == "one array":
        buffer = io.BytesIO()
        np.save(buffer, np.zeros(3))
        file.write_bytes(buffer.getvalue())
    elif what != "missing":
        file.write_bytes({"empty": b"", "text": b"q,qd\n1,2\n", "no members": empty_zip(), "pickle": pickled()}[what])
    with pytest.raises(ResultError, match=r"x\.npz: not a readable trajectory"):
        load_trajectory(file)


@pytest.mark.parametrize("name", ["t", *SIGNALS, "outcome", "failed_at", "detail"])
def test_a_file_that_lacks_an_array_is_an_error(name: str, tmp_path: Path) -> None:
    """Each of the named entries is needed."""
    content = stored()
    del content[name]
    (tmp_path / "x.npz").write_bytes(npz(**content))
    with pytest.raises(ResultError):
        load_trajectory(tmp_path / "x.npz")


def test_unknown_outcomes_and_entries_are_errors(tmp_path: Path) -> None:
    """A file from another version is refused rather than half understood."""
    for other in ({"outcome": np.array("EXPLODED")}, {"torque": np.zeros(3)}, {"failed_at": np.array("soon")}):
        (tmp_path / "x.npz").write_bytes(npz(**{**stored(), **other}))
        with pytest.raises(ResultError):
            load_trajectory(tmp_path / "x.npz")
