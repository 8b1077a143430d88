"""``torquebench check``: a table of what a user's laws keep of the contract, and where they do not."""

from __future__ import annotations

from pathlib import Path

from torquebench.check import FAIL, PASS, Report, check_law
from torquebench.check_cases import silence
from torquebench.cli.colour import bad, good
from torquebench.cli.terminal import broken, progress_bar, say, table, tell, width
from torquebench.errors import ConfigError, Problem, did_you_mean
from torquebench.laws.plugin import load_plugin

WIDTH = 96
"""Longest line of what was found, where standard output is no terminal."""


def check(file: Path, law: str | None) -> int:
    """Try the laws of a file and return 0 when everything held, else 1.

    Args:
        file: Python file that registers laws.
        law: The only one to try; None for all.

    Raises:
        ConfigError: the file registers no law, or not this one.
    """
    with silence():
        names = load_plugin(file, "FILE")
    if not names:
        raise ConfigError([Problem("FILE", str(file), "registers no law (wanted a function with @controller)")])
    if law is not None and law not in names:
        raise ConfigError([Problem("--law", "", f"{file} registers no law '{law}'{did_you_mean(law, names)}")])
    names = names if law is None else (law,)
    reports = []
    with progress_bar(len(names), "law", "starting (compiles on first use)") as bar:
        for name in names:
            bar.set_description_str(name, refresh=True)
            reports.append(check_law(name))
            bar.update(1)
    held = all(report.held for report in reports)
    tell(held=held, laws=[report.to_json() for report in reports])
    say("\n\n".join(_text(report) for report in reports))
    return 0 if held else 1


def _rows(report: Report) -> list[list[str]]:
    """Return the cells of a report's checks; off the terminal, which has a width of its own, long ones over rows."""
    tones = {PASS: good, FAIL: bad}
    rows = [[check.name, tones.get(check.verdict, str)(check.verdict), check.detail] for check in report.checks]
    return broken(rows, WIDTH) if width() is None else rows


def _text(report: Report) -> str:
    """Return a law's table, the places that keep it from being compiled, and the verdict."""
    lines = [f"law '{report.law}' ({report.file}:{report.line})", ""]
    lines.append(table(["check", "", "what was tried, or what was found"], _rows(report), left=3, prose=True))
    if report.complaints:
        lines += ["", f"Outside the dialect ({len(report.complaints)}), so that the law is interpreted:"]
        lines += [f"  {report.file}:{c.line}: {c.what}: {c.cure}" for c in report.complaints]
    failed = sum(check.verdict == "FAIL" for check in report.checks)
    both = any(check.name == "paths" and check.verdict == "pass" for check in report.checks)
    path = "on both paths" if both else "on the readable path only"
    lines += ["", f"{failed} of {len(report.checks)} checks FAILED" if failed else f"the contract holds, {path}"]
    return "\n".join(lines)
