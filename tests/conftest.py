"""The figures that tests measure, shown in a table at the end of the run."""

from collections.abc import Callable

import pytest

MEASURED = pytest.StashKey[list[tuple[str, float, str]]]()


def pytest_configure(config: pytest.Config) -> None:
    """Start with no figures."""
    config.stash[MEASURED] = []


@pytest.fixture
def figure(request: pytest.FixtureRequest) -> Callable[[str, float, str], None]:
    """Note a measured figure: what, how much, and what was promised."""

    def note(what: str, value: float, promise: str) -> None:
        request.config.stash[MEASURED].append((what, float(value), promise))

    return note


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Print the figures the tests of this run have measured."""
    rows = config.stash[MEASURED]
    if not rows:
        return
    width = max(len(what) for what, _, _ in rows)
    terminalreporter.section("measured")
    for what, value, promise in rows:
        terminalreporter.line(f"{what:<{width}}  {value:>10.3g}  promised {promise}")
