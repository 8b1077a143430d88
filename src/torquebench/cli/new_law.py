"""``torquebench new-law``: the file of a new law, to begin from, and its test."""

from __future__ import annotations

import shlex
from pathlib import Path

from torquebench.cli.app import command
from torquebench.cli.parameters import argument, out_folder
from torquebench.cli.terminal import say, tell


@command("new-law", example="torquebench new-law my-law")
@argument("name", metavar="NAME", help="its name in configs, such as my-law")
@out_folder(help="folder to write to (default: the current one)")
def new_law(name: str, out: Path | None) -> None:
    """Write a law of your own to begin from.

    NAME.py declares gains, the boxes in which tuning looks for them, and memory; test_NAME.py tests it. Both hold as
    they are. A file that exists is never written over.
    """
    from torquebench.laws.new import new_law as write

    law, test = write(name, out or ".")
    tell(law=law, test=test)
    file = shlex.quote(str(law))
    say(f"{law} and {test}: change the equation, then")
    say(f"torquebench check {file}", fold=False)
    own = shlex.quote(f"controllers=[conventional, {{name: {name}, law: {name}, gains: auto}}]")
    say(f"torquebench run fig9-chattering --plugin {file} --set {own}", fold=False)
