"""Draws that nobody knew beforehand: a secret whose hash is told before the first run, and itself after the last."""

from __future__ import annotations

import datetime
import hashlib
import secrets


def new_secret() -> str:
    """Return a secret that cannot be guessed."""
    return secrets.token_hex(16)


def commitment(secret: str) -> str:
    """Return the hash of a secret, which binds and tells nothing."""
    return hashlib.sha256(secret.encode()).hexdigest()


def seed_of(secret: str) -> int:
    """Return the seed of the draws of a secret, 56 bits."""
    return int.from_bytes(hashlib.sha256(f"draws {secret}".encode()).digest()[:7], "big")


def today() -> str:
    """Return the date, UTC."""
    return datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d")
