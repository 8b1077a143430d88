"""The JSON document that every command prints with ``--json``."""

from __future__ import annotations

import json
from collections.abc import Iterable

from torquebench.cli.terminal import Voice
from torquebench.errors import Problem
from torquebench.plain import plain


def document(command: str | None, status: int, problems: Iterable[Problem], error: str | None, voice: Voice) -> str:
    """Return one JSON document: the envelope that all commands share, then what this one has told.

    Args:
        command: Its name; None where none was understood.
        status: The exit status.
        problems: What was wrong with the input.
        error: Why the command ended early, other than by bad input.
        voice: What was told and warned of.
    """
    envelope = {
        "command": command,
        "status": status,
        "problems": [problem.to_json() for problem in problems],
        "error": error,
        "remarks": voice.remarks,
    }
    return json.dumps(plain(envelope | voice.facts), indent=2, allow_nan=False)
