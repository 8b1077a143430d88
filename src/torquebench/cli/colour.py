"""Coloured cells."""

from torquebench.cli.terminal import bad, good

__all__ = ["bad", "good"]
