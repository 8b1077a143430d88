"""Laws that do what a law must not."""

from __future__ import annotations

import json
from collections.abc import Iterator

from trust.rows import row
from trust.workshop import EXPERIMENT, Workshop

HEAD = '''\
"""A law with a fault."""
import os, sys, threading, time, warnings
from typing import NamedTuple
import numpy as np
from torquebench import Array, controller
class Gains(NamedTuple):
    k: Array
KEPT = []
class Mute(Exception):
    def __str__(self):
        raise ValueError("no text")
@controller("faulty", gains=Gains)
def faulty(gains, model, t, q, qd, ref, memory, tau):
    """A law."""
    tau[:] = 0
    if t < {instant}:
        return
    {fault}
'''
FAILS = "BAD_TORQUE CONTROLLER_ERROR".split()
HARMLESS = ["COMPLETED", *FAILS]
FAULTS = {
    'raise RuntimeError("boom <script>alert(1)</script>")': FAILS,
    "raise MemoryError": FAILS,
    "raise GeneratorExit('x')": FAILS,
    "raise Mute": FAILS,
    "raise ValueError('y' * 5_000_000)": FAILS,
    r"raise ValueError('\x1b]0;owned\x07\x1b[31mred\ud800')": FAILS,
    "sys.exit(0)": FAILS,
    "tau[:] = np.zeros(len(tau) + 1)": FAILS,
    "tau[-1] = np.nan": FAILS,
    "tau[0] = -np.inf": FAILS,
    "tau[0] = 1j": FAILS,
    "tau[0] = 'abc'": FAILS,
    "tau[len(tau) + 5] = 1.0": FAILS,
    "tau[0] = q[100_000_000]": FAILS,
    "tau[0] = 1.0 / (t - t)": FAILS,
    "np.ones(10 << 32)": FAILS,
    "f = lambda: f(); f()": FAILS,
    "f = lambda g: g(g); f(f)": FAILS,
    "return np.zeros(99)": HARMLESS,
    "q[0] = 5.0": HARMLESS,
    "ref.q[:] = 0": HARMLESS,
    "gains.k[:] = 0": HARMLESS,
    "model.tau_max[:] = 1e9": HARMLESS,
    "q.setflags(write=True); q[0] = 5.0": HARMLESS,
    "KEPT.append(tau); KEPT[0][:] = 7": HARMLESS,
    "print('the law says hello')": HARMLESS,
    "os.write(1, b'raw')": HARMLESS,
    "threading.Thread(target=time.sleep, args=(0.1,)).start() if len(threading.enumerate()) < 9 else 0": HARMLESS,
    "warnings.warn(f'w{t}')": HARMLESS,
    "np.seterr(all='raise'); tau[0] = np.float64(1.0)": HARMLESS,
    "os.chdir('/')": HARMLESS,
}
"""What a law does -> outcomes that are right."""


@row("faults", "A law's fault is its own outcome, at its instant; other laws' numbers stay.", ci=12, release=1000)
def attack_with_laws(shop: Workshop, tries: int) -> Iterator[str]:
    """Exceptions, exits, wrong shapes and types, infinite torques, writes to inputs, threads, at any instant."""
    whole = json.loads((shop.run / "metrics.json").read_text())["controllers"]["pd"]
    faults = list(FAULTS.items())
    shop.random.shuffle(faults)
    for number in range(tries):
        fault, outcomes = faults[number % len(faults)]
        instant = shop.random.choice([0.0, 0.001, round(shop.random.uniform(0.0, 1.19), 3), 1.199])
        law, config, out = shop.folder / "faulty.py", shop.folder / "faulty.yaml", shop.absent("faulty")
        law.write_text(HEAD.replace("{instant}", f"{instant - 1e-9}").replace("{fault}", fault), encoding="utf-8")
        other = "  - {name: bad, law: faulty, gains: {k: 1}}\nreference"
        config.write_text(EXPERIMENT.replace("reference", other, 1), encoding="utf-8")
        done = shop.command("run", config, "--plugin", law, "--out", out)
        found = done.fault(0, 1)
        if not found and any(c < " " and c not in "\n\r\t" for c in done.text.replace("\x1b[K", "")):
            found = "control characters in what it prints"
        if not found:
            outcome = json.loads((out / "manifest.json").read_text())["outcomes"]["bad"]
            metrics = json.loads((out / "metrics.json").read_text())["controllers"]
            if outcome["outcome"] not in outcomes:
                found = f"outcome {outcome['outcome']}"
            elif outcome["outcome"] in FAILS and outcome["failed_at"] != round(instant / 0.001):
                found = f"said to have failed at instant {outcome['failed_at']}"
            elif metrics.get("bad") and outcome["outcome"] != "COMPLETED":
                found = "metrics of a run that failed"
            elif metrics["pd"] != whole:
                found = "the other controller's metrics moved"
        yield f"{fault} at {instant:g} s: {found}" if found else ""
