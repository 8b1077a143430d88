"""Folders that a command has begun to fill and not finished: one that is interrupted says which."""

from __future__ import annotations

from pathlib import Path

BEGUN: list[Path] = []
"""These folders, in the order in which they were begun."""
