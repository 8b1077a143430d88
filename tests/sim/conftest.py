"""Tests of two sizes: the small one runs by default, the large one, marked slow, with ``-m slow``."""

from collections.abc import Callable
from typing import Any

import pytest

from torquebench.sim import native


@pytest.fixture(autouse=True)
def short_runs_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile the runs of these tests, short as they are: the loop is what they are about, not when it is compiled."""
    monkeypatch.setattr(native, "WORTH", 0)


@pytest.fixture(params=[pytest.param(False, id="small"), pytest.param(True, id="large", marks=pytest.mark.slow)])
def large(request: pytest.FixtureRequest) -> bool:
    """Whether this is the large size of a test."""
    return bool(request.param)


@pytest.fixture
def size(large: bool) -> Callable[[Any, Any], Any]:
    """Choose between a small and a large size."""
    return lambda few, many: many if large else few


@pytest.fixture
def tell(large: bool, capsys: pytest.CaptureFixture[str]) -> Callable[[str], None]:
    """Say how far a long test has come; at the small size, nothing."""

    def say(text: str) -> None:
        if large:
            with capsys.disabled():
                print(text, flush=True)  # noqa: T201

    return say
