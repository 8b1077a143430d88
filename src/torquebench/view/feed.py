"""Messages for a page, in order: those who show it may come at any time and get all of them."""

from __future__ import annotations

import json
import threading

from torquebench.view.replay import Message


class Feed:
    """A growing list of messages, safe to use from several threads."""

    def __init__(self) -> None:
        self._lines: list[bytes] = []
        self._changed = threading.Condition()
        self._closed = False
        self.visited = threading.Event()
        """Set once someone has asked for messages."""
        self.taken = threading.Event()
        """Set once someone has got all messages, the last one included."""

    def add(self, message: Message) -> None:
        """Append a message."""
        line = json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
        with self._changed:
            self._lines.append(line)
            self._changed.notify_all()

    def close(self) -> None:
        """Append the last message, after which there is none."""
        self.add({"kind": "end"})
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def since(self, first: int, patience: float) -> bytes:
        """Return the messages from number `first` on as a JSON array; wait up to `patience` [s] for the first."""
        with self._changed:
            self.visited.set()
            self._changed.wait_for(lambda: len(self._lines) > first or self._closed, patience)
            return b"[" + b",".join(self._lines[first:]) + b"]"

    def told(self, next_wanted: int) -> None:
        """Note that someone has the messages before number `next_wanted`."""
        with self._changed:
            if self._closed and next_wanted >= len(self._lines):
                self.taken.set()

    def __len__(self) -> int:
        return len(self._lines)
