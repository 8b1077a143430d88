"""A stored trajectory is what a run leaves, or it is refused in one line that says why."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from torquebench import load_trajectory
from torquebench.errors import ResultError
from torquebench.sim.trajectory import SIGNALS, Outcome, Trajectory

N, JOINTS = 5, 2


def arrays():
    """The members of a stored run."""
    values = {name: np.arange(N * JOINTS, dtype=float).reshape(N, JOINTS) / 10 for name in SIGNALS}
    return {"t": np.arange(N) / 1000, **values, "memory_integral": np.zeros((N, JOINTS))} | {
        "outcome": np.array("COMPLETED"),
        "failed_at": np.array(-1),
        "detail": np.array(""),
    }


def write(path, changes=()):
    """Write a stored run in which some members are others, or missing where None."""
    members = arrays() | dict(changes)
    np.savez(path, **{name: value for name, value in members.items() if value is not None})
    return path


def test_a_run_is_read_back_as_it_was(tmp_path):
    """Of a completed run and of a failed one, whose last row may hold NaN."""
    assert load_trajectory(write(tmp_path / "a.npz")).completed
    end = arrays()["tau"]
    end[-1] = np.nan
    failed = {"outcome": np.array("BAD_TORQUE"), "failed_at": np.array(N - 1), "tau": end, "tau_applied": end}
    run = load_trajectory(write(tmp_path / "b.npz", failed))
    assert (run.outcome, run.failed_at) == (Outcome.BAD_TORQUE, N - 1)
    again = tmp_path / "c.npz"
    again.write_bytes(Trajectory(**{name: getattr(run, name) for name in Trajectory.__slots__}).to_bytes())
    assert load_trajectory(again).digest() == run.digest()


Q = arrays()["q"]
WRONG = {
    "float16": {"q": Q.astype(np.float16)},
    "bool": {"q": Q > 0},
    "integers": {"q": Q.astype(int)},
    "complex": {"q": Q.astype(complex)},
    "another byte order": {"q": Q.astype(">f8")},
    "text": {"q": np.full(Q.shape, "a")},
    "a number": {"q": np.array(1.0)},
    "another shape": {"q": Q[:, :1]},
    "another length": {"q": Q[:-1]},
    "no joints": {name: np.zeros((N, 0)) for name in (*SIGNALS, "memory_integral")},
    "no instants": {name: value[:0] for name, value in arrays().items() if value.ndim},
    "NaN": {"q": Q * np.nan},
    "too far": {"q": Q + 1e308},
    "no times": {"t": np.full(N, np.nan)},
    "times that fall": {"t": np.arange(N)[::-1] / 1000},
    "a member of another name": {"path": Q},
    "a member missing": {"tau": None},
    "memory of another shape": {"memory_integral": np.zeros(N)},
    "a failure in a completed run": {"failed_at": np.array(10**18)},
    "a failure without an instant": {"outcome": np.array("DIVERGED")},
    "an outcome that there is not": {"outcome": np.array("FINE")},
    "objects": {"q": np.array([[object()] * JOINTS] * N)},
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_no_run_leaves_is_refused(tmp_path, kind):
    """Types, shapes, names and values that no run has; one line with the file's name."""
    path = write(tmp_path / "a.npz", WRONG[kind])
    with pytest.raises(ResultError, match=r"a\.npz: not a readable trajectory") as caught:
        load_trajectory(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 1)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (((((}",
        "nonsense \\",
        "{'descr': 'O', 'fortran_order': False, 'shape': (5, 2)}",
    ],
)
def test_a_header_that_lies_is_refused(tmp_path, header):
    """A size beyond all memory, brackets that do not close, objects: an error of ours, and no memory taken."""
    path, buffer = write(tmp_path / "a.npz"), io.BytesIO()
    text = header.encode() + b" " * 20 + b"\n"
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(buffer, "w") as new:
        for name in old.namelist():
            lying = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text
            new.writestr(name, lying if name == "q.npy" else old.read(name))
    path.write_bytes(buffer.getvalue())
    with pytest.raises(ResultError, match="not a readable trajectory"):
        load_trajectory(path)
