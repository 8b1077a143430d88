"""``python scripts/paper``: the same as ``torquebench paper``."""

import sys

from torquebench.__main__ import start

if __name__ == "__main__":
    sys.argv[1:1] = ["paper"]
    sys.exit(start())
