"""One experiment by every way that must not matter: paths, workers, hash seeds, locales, environments."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator

from trust.rows import row
from trust.workshop import EXPERIMENT, Workshop, differing, sweep_words, tree

RUN = """
import sys, torquebench
result = torquebench.run_experiment(sys.argv[1], path=sys.argv[2])
print(*(run.digest() for run in result.trajectories.values()), result.metrics.to_json(double_precision=15))
"""


@row("same-bytes", "On one processor the bytes of a result depend on the config alone.", ci=8, release=24)
def attack_equality(shop: Workshop, tries: int) -> Iterator[str]:
    """Both paths, threads, processes of 1 to 3 workers, Dask, hash seeds, locales, -O, thread limits, other folders."""
    whole, _ = shop.sweep
    wanted = tree(whole)
    sweeps = [("threads", 1), ("processes", 2), ("processes", 3), ("threads", 3)]
    if importlib.util.find_spec("distributed"):
        sweeps.append(("dask", 2))
    environments = [{"PYTHONHASHSEED": "1"}, {"LC_ALL": "C"}, {"LC_ALL": "tr_TR.UTF-8", "LANG": "tr_TR.UTF-8"}]
    environments += [
        {"PYTHONOPTIMIZE": "2"},
        {"OMP_NUM_THREADS": "1"},
        {"NUMBA_NUM_THREADS": "1"},
        {"TZ": "Asia/Tokyo"},
    ]
    environments += [{"PYTHONHASHSEED": str(shop.random.randrange(2**32))} for _ in range(5)]
    first = _digest(shop, "python", {})
    runs = [("native", {})] + [(path, e) for e in environments for path in ("python", "native")]
    plan: list[tuple[str, object]] = [item for pair in zip(runs, sweeps, strict=False) for item in pair]
    plan += [*runs[len(sweeps) :], *sweeps[len(runs) :]]
    for what, how in plan[:tries]:  # type: ignore[assignment]
        if isinstance(how, dict):
            found = "" if _digest(shop, what, how) == first else "other digests or metrics"
            yield f"{what} {how}: {found}" if found else ""
            continue
        out = shop.absent("other")
        words = list(sweep_words(shop.sweep_config, out, what))
        if what == "dask":
            words = ["sweep", str(shop.sweep_config), "--out", str(out), "--quiet", "--cluster", "local:2"]
        words[-1] = str(how) if what != "dask" else words[-1]
        done = shop.command(*words, limit=300.0)
        found = done.fault(0) or ", ".join(differing(wanted, tree(out))[:3])
        yield f"sweep by {how} {what}: {found}" if found else ""


def _digest(shop: Workshop, path: str, environment: dict[str, str]) -> str:
    """Return a digest of trajectories and metrics, computed by a fresh program in an environment."""
    config = shop.folder / "elsewhere" / "short.yaml"
    config.parent.mkdir(exist_ok=True)
    config.write_text(EXPERIMENT, encoding="utf-8")
    line = [sys.executable, "-c", RUN, str(config), path]
    text = subprocess.run(line, env=os.environ | environment, check=True, capture_output=True, timeout=300).stdout
    return hashlib.sha256(text).hexdigest()
