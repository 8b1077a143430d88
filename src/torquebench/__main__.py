"""``python -m torquebench``."""

import sys

from torquebench.cli.main import main

sys.exit(main())
