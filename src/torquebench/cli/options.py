"""What other files take from here until they are converted."""

from torquebench.cli.parameters import check_out

__all__ = ["check_out"]
