"""How a motion is shown by ``view`` and ``run --live``: the options, and what is refused."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from torquebench.errors import ConfigError, Problem
from torquebench.video.settings import FASTEST, SLOWEST


@dataclass(frozen=True, slots=True)
class Showing:
    """The choices of a user."""

    browser: bool = False
    """In the browser even where a window opens."""
    open_it: bool = True
    """Open the browser; else its address is printed only."""
    speed: float = 1.0
    """Simulated seconds shown in one second."""
    port: int = 0
    """Port of the page; 0 for a free one."""

    @classmethod
    def of(cls, options: argparse.Namespace) -> Showing:
        """Return the choices of a command line.

        Raises:
            ConfigError: one is impossible.
        """
        speed, port = options.speed or 1.0, options.port or 0
        problems = []
        if options.speed is not None and not SLOWEST <= options.speed <= FASTEST:
            problems.append(Problem("--speed", "", f"got {options.speed:g}, wanted {SLOWEST:g} to {FASTEST:g}"))
        if not 0 <= port <= 65535:
            problems.append(Problem("--port", "", f"got {port}, wanted 1 to 65535, or 0 for a free one"))
        if problems:
            raise ConfigError(problems)
        return cls(options.browser or options.no_open or port > 0, not options.no_open, speed, port)


def live_of(options: argparse.Namespace) -> Showing | None:
    """Return how a run is watched, or None where it is not.

    Raises:
        ConfigError: a choice is impossible, or nothing is to be watched.
    """
    if options.live:
        return Showing.of(options)
    given = {
        "--browser": options.browser,
        "--no-open": options.no_open,
        "--speed": options.speed is not None,
        "--port": options.port is not None,
    }
    if any(given.values()):
        raise ConfigError([Problem(name, "", "wanted --live as well") for name, there in given.items() if there])
    return None
