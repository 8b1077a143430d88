"""When a run is interpreted although it could be compiled: the rule of `reason_to_interpret`."""

import json
import logging
import math
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.arms import pack
from tests.sim.loops import go, plant_of
from torquebench import find_law
from torquebench.kernel import cache
from torquebench.kernel.cache import interpreted_steps
from torquebench.sim import native, session
from torquebench.sim.native import LOOP, QUICKER, RUN_SIGNATURE, NativeFunction, reason_to_interpret

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def own_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """Count interpreted steps from zero."""
    counts = Counter[str]()

    def count(name: str, more: int = 0) -> int:
        counts[name] += more
        return counts[name]

    monkeypatch.setattr(native, "interpreted_steps", count)


PD = pack("pd", 2, lam=8, kv=12)


def test_a_first_short_run_compiles_nothing(tmp_path: Path) -> None:
    """With an empty cache: no kernel on disk afterwards, certificates included, and the manifest says why.

    The digests equal those of compiled runs: ``tests/freeze.py`` compares them, and other tests here.
    """
    out, cache = tmp_path / "out", tmp_path / "cache"
    settings = ["--set", "run.duration=0.5", "--set", "run.metrics_from=0", "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-m", "torquebench", "run", "configs/paper/fig9-chattering.yaml", *settings],
        cwd=ROOT,
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert [path for path in cache.rglob("*") if path.suffix in (".nbi", ".nbc")] == []
    assert "interpreted" not in done.stderr
    runs = json.loads((out / "manifest.json").read_text())["outcomes"]
    assert {(run["path"], run["path_reason"]) for run in runs.values()} == {("python", QUICKER)}
    assert (out / "certificates.json").is_file()


@pytest.mark.parametrize(("steps", "compiled", "reason"), [(10, False, QUICKER), (10, True, ""), (10**6, False, "")])
def test_the_rule(steps: int, compiled: bool, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few steps are interpreted unless their kernels are there; many are compiled."""
    monkeypatch.setattr(native, "WORTH", 1000)
    monkeypatch.setattr(native, "_is_compiled", lambda *_: compiled)
    assert reason_to_interpret(plant_of("mujoco"), find_law("pd"), steps) == reason


def test_one_run_after_the_other_goes_over_to_compiled_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """The steps of a process add up; bytes stay the same, and a long run asked for at once is compiled at once."""
    steps = len(go(plant_of("mujoco"), PD, path="python").t)
    monkeypatch.setattr(native, "_is_compiled", lambda *_: False)
    monkeypatch.setattr(native, "WORTH", 1e9)
    monkeypatch.setattr(native, "OFTEN", 2.5 * steps)
    runs = [go(plant_of("mujoco"), PD) for _ in range(3)]
    assert [(run.path, run.path_reason) for run in runs] == [("python", QUICKER), ("python", QUICKER), ("native", "")]
    assert len({run.digest() for run in runs}) == 1


def test_going_over_to_compiled_runs_is_said_and_begins_anew(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Each law's steps count for itself; one line says it; what cannot be compiled is not tried again each time."""
    monkeypatch.setattr(native, "_is_compiled", lambda *_: False)
    native._say_compiling.cache_clear()
    caplog.set_level(logging.INFO, "torquebench")
    other = pack("pd-gravity", 2, lam=8, kv=12)
    monkeypatch.setattr(native, "WORTH", 1e9)
    monkeypatch.setattr(native, "OFTEN", 2.5 * len(go(plant_of("mujoco"), PD, path="python").t))
    paths = [go(plant_of("mujoco"), law).path for law in (PD, other, PD, PD, PD, other)]
    assert paths == ["python"] * 3 + ["native", "python", "python"]
    assert [record.getMessage() for record in caplog.records] == [native.COMPILING]


def test_a_count_that_cannot_be_read_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing, text that is no number, and a folder in its place; the count goes on once it can be written."""
    monkeypatch.setattr(cache, "cache_folder", lambda: tmp_path)
    assert interpreted_steps("a", 5) == interpreted_steps("a") == 5
    assert interpreted_steps("a", 7) == 12
    assert interpreted_steps("b") == 0
    (tmp_path / "interpreted" / "a").write_bytes(b"5\n\xff\n")
    (tmp_path / "interpreted" / "c").mkdir()
    assert (interpreted_steps("a"), interpreted_steps("c", 5)) == (0, 0)


def test_a_compiled_function_is_found_on_disk_without_loading_it() -> None:
    """One object's kernel is seen by another of the same code; one that was never compiled is not there."""
    assert LOOP.address > 0
    assert NativeFunction(RUN_SIGNATURE, native._run).is_compiled

    def never(address: int, first: int, last: int) -> int:
        return address + 17 * first - last

    assert not NativeFunction(RUN_SIGNATURE, never).is_compiled


def test_steps_of_a_plant_that_is_slow_to_interpret_count_more() -> None:
    """An analytic plant's equations take many times as long as a law; MuJoCo's step is compiled anyhow."""
    slow, quick = session._burden(plant_of("analytic"), 2), session._burden(plant_of("mujoco"), 2)
    assert slow > 10 * quick
    assert quick == 1
    assert math.isfinite(slow)
