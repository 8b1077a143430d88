"""Where a run cannot be compiled: `auto` takes the readable path and says why, `native` refuses, results stay equal."""

from __future__ import annotations

import ctypes
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest

from tests.arms import pack
from tests.sim.loops import arm, go, idle, law_of, plant_of
from torquebench.errors import ControllerError
from torquebench.kernel import Array
from torquebench.laws import find_law
from torquebench.laws.law import Law
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.sim.plants import NativeError, Plant, mujoco_native
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.session import Controller
from torquebench.sim.trajectory import Outcome

ROOT = Path(__file__).resolve().parents[2]
PD = pack("pd", 2, lam=8, kv=12)


def check_fallback(plant: Plant, controller: Controller, reason: str) -> None:
    """Run with each path; `reason` is a pattern of what is said."""
    run = go(plant, controller, path="auto")
    assert run.path == "python"
    assert re.search(reason, run.path_reason), run.path_reason
    with pytest.raises(ControllerError, match=f"controller '{controller.name}' cannot run on the native path: ") as e:
        go(plant, controller, path="native")
    assert re.search(reason, str(e.value))
    readable = go(plant, controller, path="python")
    assert (readable.path, readable.path_reason) == ("python", "")
    assert readable.digest() == run.digest()
    if controller is PD:
        healthy = go(MujocoPlant("two-link") if isinstance(plant, MujocoPlant) else plant_of("analytic"), PD)
        assert healthy.digest() == run.digest()


def test_a_run_that_can_be_compiled_is_and_says_nothing() -> None:
    """`auto` is native on both plants, without a reason; so is `native`; `python` is what was asked for."""
    for name in ("analytic", "mujoco"):
        runs = [go(plant_of(name), PD, path=path) for path in ("auto", "native", "python")]
        assert [(run.path, run.path_reason) for run in runs] == [("native", ""), ("native", ""), ("python", "")]
        assert len({run.digest() for run in runs}) == 1


@pytest.fixture
def fresh_library() -> Iterator[None]:
    """Look the library up anew in a test, and again after it."""
    mujoco_native.library.cache_clear()
    yield
    mujoco_native.library.cache_clear()


def test_a_library_that_lacks_a_function(monkeypatch: pytest.MonkeyPatch, fresh_library: None) -> None:
    """The function is named, with MuJoCo's version; the analytic plant is not concerned."""
    monkeypatch.setitem(mujoco_native.SIGNATURES, "mj_noSuchThing", mujoco_native.SIGNATURES["mj_step"])
    check_fallback(MujocoPlant("two-link"), PD, f"MuJoCo {mujoco.__version__} exports no mj_noSuchThing")
    assert go(plant_of("analytic"), PD).path == "native"


@pytest.mark.parametrize("files", [(), ("libmujoco.so.1", "libmujoco.so.2")])
def test_a_library_that_is_not_found(
    files: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh_library: None
) -> None:
    """None or two of them in MuJoCo's package: no guess is made."""
    for file in files:
        (tmp_path / file).write_bytes(b"")
    monkeypatch.setattr(mujoco, "__file__", str(tmp_path / "__init__.py"))
    check_fallback(MujocoPlant("two-link"), PD, f"{len(files)} MuJoCo libraries in its package, wanted one")


class OtherState:
    """A library that knows another state than the one it is asked about."""

    def __init__(self) -> None:
        self.mj_getState = self.Answer()

    class Answer:
        """A function whose types may be declared."""

        argtypes: Any = None
        restype: Any = None

        def __call__(self, m: int, d: int, out: int, what: int) -> None:
            """Write a zero."""
            ctypes.memset(out, 0, 8)


def test_an_address_that_does_not_check_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The library is asked for a marked state first; when it answers with another, its address is not used."""
    plant = MujocoPlant("two-link")
    q, qd = np.array([0.3, -0.4]), np.array([0.5, 0.6])
    plant.reset(q, qd)
    monkeypatch.setattr(mujoco_native, "library", OtherState)
    with pytest.raises(NativeError, match="reads another state"):
        plant.native()
    assert [x.tolist() for x in plant.state()] == [q.tolist(), qd.tolist()]
    check_fallback(plant, PD, "MuJoCo's library reads another state than its Python bindings write")


def test_structures_that_do_not_tell_their_address() -> None:
    """Bindings without addresses are an obstacle with a name, not an AttributeError."""
    with pytest.raises(NativeError, match=f"MuJoCo {mujoco.__version__} does not tell where its structures lie"):
        mujoco_native.addresses(SimpleNamespace(), SimpleNamespace())


def test_asking_for_addresses_changes_no_state() -> None:
    """The mark that is written for the check is taken away again, on the plant itself."""
    plant = MujocoPlant("puma560")
    plant.reset(np.linspace(0.1, 0.6, 6), np.linspace(-1.0, 1.0, 6))
    before = [x.tobytes() for x in plant.state()]
    plant.native()
    assert [x.tobytes() for x in plant.state()] == before


class TiredMujoco(MujocoPlant):
    """A plant that gives half of the torque."""

    def step(self, tau: Array, substeps: int) -> None:
        """Step with half of the torque."""
        super().step(0.5 * tau, substeps)


class TiredAnalytic(AnalyticPlant):
    """The same on the analytic plant."""

    def step(self, tau: Array, substeps: int) -> None:
        """Step with half of the torque."""
        super().step(0.5 * tau, substeps)


@pytest.mark.parametrize("make", [lambda: TiredMujoco("two-link"), lambda: TiredAnalytic(arm())])
def test_a_subclass_keeps_its_own_step(make: Callable[[], Plant]) -> None:
    """A subclass may step in its own way, so the native form of its parent is not taken; nor is it by a replica."""
    kind = type(make()).__name__
    run = go(make(), PD)
    assert (run.path, run.digest()) == ("python", go(make(), PD, path="python").digest())
    assert f"the plant is a {kind}; only a {kind.replace('Tired', '')}" in run.path_reason.replace("Plant", "")
    assert go(make().replica(), PD).digest() == run.digest()
    name = "mujoco" if "Mujoco" in kind else "analytic"
    assert run.digest() != go(plant_of(name), PD).digest()
    with pytest.raises(ControllerError, match=f"the plant is a {kind}"):
        go(make(), PD, path="native")


class Foreign:
    """A plant of somebody else's, around one of ours."""

    def __init__(self) -> None:
        inner = plant_of("analytic")
        self.n, self.timestep, self.tau_max = inner.n, inner.timestep, inner.tau_max
        self.reset, self.state, self.step, self.replica = inner.reset, inner.state, inner.step, inner.replica


def test_a_plant_without_a_native_form() -> None:
    """The protocol does not ask for one; the plant is named by its class."""
    check_fallback(Foreign(), PD, "the plant, a Foreign, has no native form")


def in_numpy(gains: Any, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
    """PD with an expression on whole arrays."""
    tau[:] = gains.kv * model.inertia_scale * (ref.qd - qd + gains.lam * (ref.q - q))


class Untyped(NamedTuple):
    """Gains of which one cannot reach compiled code."""

    name: str


def test_a_law_outside_the_dialect() -> None:
    """The reason has the law's name, the line and what stands there; the run is the compiled law's to rounding."""
    law = find_law("pd")
    mine = Controller("mine", Law("mine", in_numpy, law.gains_type, None, law.gains, {}), PD.gains)
    check_fallback(plant_of("analytic"), mine, r"law 'mine' keeps to Python: line \d+: tau\[:\]: loop over")
    # the same numbers in another order of operations
    apart = np.abs(go(plant_of("analytic"), mine).q - go(plant_of("analytic"), PD).q)
    assert np.max(apart) < 1e-12


@pytest.mark.parametrize(("gains_type", "gains"), [(tuple, ()), (Untyped, Untyped("x"))])
def test_gains_that_compiled_code_cannot_receive(gains_type: Any, gains: Any) -> None:
    """Gains without fields, or with text in them, keep a law on the readable path."""
    law = Law("mine", idle, gains_type, None, {}, {})
    check_fallback(plant_of("analytic"), Controller("mine", law, gains), "law 'mine' keeps to Python: ")
    assert law_of(idle).law.gains_type is tuple


SWITCHED_OFF = """
from tests.arms import pack
from tests.sim.loops import go, plant_of
from torquebench.errors import ControllerError
for name in ("analytic", "mujoco"):
    run = go(plant_of(name), pack("pd", 2, lam=8, kv=12))
    try:
        go(plant_of(name), pack("pd", 2, lam=8, kv=12), path="native")
    except ControllerError as error:
        print(run.digest(), run.path, run.path_reason in str(error), run.path_reason)
"""


def test_numba_switched_off() -> None:
    """With NUMBA_DISABLE_JIT=1 everything runs interpreted, says so, and gives the same bytes."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SWITCHED_OFF],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        timeout=120,
    )
    wanted = [
        f"{go(plant_of(name), PD).digest()} python True numba is switched off (NUMBA_DISABLE_JIT)"
        for name in ("analytic", "mujoco")
    ]
    assert done.stdout.splitlines() == wanted


def test_a_failing_run_fails_alike_on_either_path() -> None:
    """The outcome does not depend on why a path was taken: a disturbance ends three runs at the same step."""
    d = np.zeros((50, 2))
    d[7, 1] = 1e9
    runs = [go(plant_of("mujoco"), PD, disturbance=d, path=path) for path in ("auto", "native", "python")]
    assert {(run.outcome, run.failed_at, run.detail) for run in runs} == {(Outcome.DIVERGED, 7, runs[0].detail)}
    assert len({run.digest() for run in runs}) == 1
