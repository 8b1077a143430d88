"""The study of the paper, which lies beside the package: its folder is made importable here."""

import sys

from torquebench.robot.library import data_root

if str(data_root() / "scripts") not in sys.path:
    sys.path.insert(0, str(data_root() / "scripts"))
