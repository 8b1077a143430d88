"""The figures that tests measure, shown in a table at the end of the run; and Ctrl-C as it is from a terminal."""

import gc
import signal
from collections.abc import Callable, Iterator

import pytest

from torquebench.cli.app import main
from torquebench.registry import restored

# a shell that starts the tests in the background has them, and all that they start, ignore Ctrl-C, which many test
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.disable()  # until all is collected: what is imported and collected stays, and was looked through again and again

MEASURED = "measured"
"""Name of the property under which a test's report carries a figure, from whichever process ran it."""


@pytest.fixture
def figure(request: pytest.FixtureRequest) -> Callable[[str, float, str], None]:
    """Note a measured figure: what, how much, and what was promised."""

    def note(what: str, value: float, promise: str) -> None:
        request.node.user_properties.append((MEASURED, (what, float(value), promise)))

    return note


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run the command line: (exit status, standard output, standard error)."""

    def run(*arguments: object) -> tuple[int, str, str]:
        status = main([str(a) for a in arguments])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.fixture
def registries() -> Iterator[None]:
    """Forget in the end what a test registers, of whatever kind."""
    with restored():
        yield


def pytest_collection_finish() -> None:
    """Keep what was imported and collected out of garbage collections: it lives to the end, and takes a second each.

    Collect seldom: a figure is tens of thousands of objects, and was looked through dozens of times while it grew.
    """
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the figures the tests of this run have measured."""
    ended = [report for kind in ("passed", "failed") for report in terminalreporter.stats.get(kind, [])]
    rows = [value for report in ended for name, value in report.user_properties if name == MEASURED]
    if not rows:
        return
    width = max(len(what) for what, _, _ in rows)
    terminalreporter.section("measured")
    for what, value, promise in rows:
        terminalreporter.line(f"{what:<{width}}  {value:>10.3g}  promised {promise}")
