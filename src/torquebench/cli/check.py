"""``torquebench check``: a table of what a user's laws keep of the contract, and where they do not."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.cli.app import command
from torquebench.cli.parameters import File, argument, option, refuse, suggest
from torquebench.cli.terminal import bad, good, progress_bar, say, table, tell
from torquebench.errors import ConfigError, Problem

if TYPE_CHECKING:
    from collections.abc import Sequence

    from torquebench.check import Report
    from torquebench.dialect import Complaint


@command(example="torquebench check my_law.py")
@argument("file", type=File(".py"), help="Python file of laws, as for --plugin")
@option("--law", metavar="NAME", help="the only law of the file to try (default: all)")
def check(file: Path, law: str | None) -> int:
    """Test laws of your own: can the loop rely on them?

    Every law that FILE registers with @controller is tried, on two arms and on both paths; whether it can be
    compiled is said too. The exit status is 0 when everything held, else 1.
    """
    from torquebench.check import check_law
    from torquebench.check_cases import silence
    from torquebench.dialect import complaints
    from torquebench.laws import find_law
    from torquebench.laws.plugin import load_plugin

    with silence():
        names = load_plugin(file, "FILE")
    if not names:
        raise ConfigError([Problem("FILE", str(file), "registers no law (wanted a function with @controller)")])
    if law is not None and law not in names:
        refuse([Problem("--law", text=f"{file} registers no law '{law}'", **suggest(law, names))])
    names = names if law is None else (law,)
    outside = {name: complaints(find_law(name)) for name in names}
    for name in names:
        if outside[name]:
            say(_outside(name, file, outside[name]) + "\n")
    reports = []
    with progress_bar(len(names), "law", "starting (compiles on first use)") as bar:
        for name in names:
            reports.append(check_law(name, lambda what, name=name: bar.describe(f"{name}: {what}")))  # type: ignore[misc]
            bar.update(1)
    held = all(report.held for report in reports)
    tell(held=held, laws=[report.to_json() for report in reports])
    say("\n\n".join(_text(report) for report in reports))
    return 0 if held else 1


def _outside(name: str, file: Path, places: Sequence[Complaint]) -> str:
    """Return the places that keep a law from being compiled, which are known before anything is run."""
    count = f"{len(places)} place{'s' * (len(places) > 1)}"
    places_text = [f"  {file}:{c.line}: {c.what}: {c.cure}" for c in places]
    return "\n".join([f"law '{name}' is outside the dialect in {count}, so that it is interpreted:", *places_text])


def _text(report: Report) -> str:
    """Return a law's table, and the verdict."""
    from torquebench.check import FAIL, PASS

    tones = {PASS: good, FAIL: bad}
    rows = [[check.name, tones.get(check.verdict, str)(check.verdict), check.detail] for check in report.checks]
    lines = [f"law '{report.law}' ({report.file}:{report.line})", ""]
    lines.append(table(["check", "", "what was tried, or what was found"], rows, left=3, prose=True))
    failed = sum(check.verdict == "FAIL" for check in report.checks)
    both = any(check.name == "paths" and check.verdict == "pass" for check in report.checks)
    path = "on both paths" if both else "on the readable path only"
    lines += ["", f"{failed} of {len(report.checks)} checks FAILED" if failed else f"the contract holds, {path}"]
    return "\n".join(lines)
