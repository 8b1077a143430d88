"""The option that rewrites the page."""

import sys

import pytest

if sys.platform == "win32":
    collect_ignore_glob = ["test_*.py"]  # Pinocchio, the independent arm, has no wheels there


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --write-errata."""
    parser.addoption("--write-errata", action="store_true", help="rewrite docs/errata.md from computed numbers")
