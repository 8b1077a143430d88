"""Processes that are killed or interrupted at any instant."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

from trust.rows import row
from trust.workshop import Workshop, differing, sweep_words, tree

STOP = 30.0
"""Time after a signal at which a command counts as deaf [s]; it ends in one, on a machine with nothing else to do."""


@row("kills", "A sweep killed at any instant is resumed to the bytes of one that was not.", ci=4, release=200)
def attack_with_kills(shop: Workshop, tries: int) -> Iterator[str]:
    """Kill -9 at a random instant, up to four times in a row, then --resume; worker processes or threads."""
    whole, usual = shop.sweep
    wanted = tree(whole)
    for number in range(tries):
        executor = "processes" if number % 4 == 3 else "threads"
        out, found, instants = shop.absent("killed"), "", list[str]()
        words = sweep_words(shop.sweep_config, out, executor)
        for _ in range(shop.random.choice([1, 1, 2, 4])):
            after = shop.random.uniform(0.0, usual)
            instants.append(f"{after:.2f} s")
            shop.command(*words, after=after, with_signal=signal.SIGKILL)
            words = _again(out) or words
        done = shop.command(*words, limit=120.0)
        if (out / "manifest.json").exists() or not done.status:
            found = ", ".join(differing(wanted, tree(out))[:3])
        yield f"killed after {', '.join(instants)}: {found or done.fault(0)}" if found or done.fault(0, 2) else ""


def _again(out: Path) -> list[str]:
    """Return the line that goes on with a killed sweep; empty if it had not begun."""
    return ["sweep", "--resume", str(out), "--quiet", "--executor", "threads"] if (out / "plan.json").exists() else []


@row(
    "signals",
    "Ctrl-C ends with status 130, SIGTERM with 143, and nothing is left half-written.",
    ci=6,
    release=200,
)
def attack_with_signals(shop: Workshop, tries: int) -> Iterator[str]:
    """SIGINT or SIGTERM at a random instant of run, sweep or report."""
    wanted = tree(shop.run)
    whole, usual = shop.sweep
    lines = {"run": ["run", str(shop.config)], "sweep": [], "report": ["report", str(shop.run)]}
    for number in range(tries):
        kind = list(lines)[number % 3]
        out = shop.absent("stopped")
        line = list(sweep_words(shop.sweep_config, out)) if kind == "sweep" else [*lines[kind], "--out", str(out)]
        sent = shop.random.choice([signal.SIGINT, signal.SIGTERM])
        after = shop.random.uniform(0.0, usual)
        done = shop.command(*line, after=after, with_signal=sent, limit=STOP)
        right = {signal.SIGINT: 130, signal.SIGTERM: 143}[sent]
        # before its first line runs, a process is ended by the signal itself
        found = done.fault(0, right, -sent)
        left = [path.name for path in shop.folder.rglob("*") if path.suffix == ".tmp" and "sweep" != kind]
        if not found and left:
            found = f"left {', '.join(left[:3])}"
        if not found and kind == "run" and out.is_dir():
            altered = [
                name for name, digest in tree(out).items() if wanted.get(name) != digest and name != "unfinished"
            ]
            found = f"other bytes in {', '.join(altered[:3])}" if altered else ""
        if not found and kind == "sweep" and (out / "manifest.json").exists():
            found = ", ".join(differing(tree(whole), tree(out))[:3])
        yield f"{kind}, {sent.name} after {after:.2f} s: {found}" if found else ""
