"""``torquebench completion``: the script by which a shell asks this program what may follow, and what it answers."""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path

import click
from click.shell_completion import (
    BashComplete,
    FishComplete,
    ZshComplete,
    add_completion_class,
    get_completion_class,
    split_arg_string,
)

from torquebench.cli.app import ENVIRONMENT, PROGRAM, app, command
from torquebench.cli.parameters import Choice, argument, option
from torquebench.cli.terminal import say, tell
from torquebench.errors import ConfigError, Problem
from torquebench.shipped import config_keys, find_config

SHELLS = ("bash", "zsh", "fish")
PLACES = {
    "bash": "~/.local/share/bash-completion/completions/torquebench",
    "zsh": "~/.zfunc/_torquebench",
    "fish": "~/.config/fish/completions/torquebench.fish",
}
"""Where each shell looks for the script; zsh does where ~/.zfunc is in its fpath."""

BASH = r"""# completion of torquebench in bash, printed by: torquebench completion bash
%(complete_func)s() {
    local IFS=$'\n' kind value
    COMPREPLY=()
    while IFS=, read -r kind value; do
        [[ $kind == plain ]] && COMPREPLY+=("$value")
    done < <(COMP_LINE=$COMP_LINE COMP_POINT=$COMP_POINT COMP_WORDBREAKS=$COMP_WORDBREAKS \
        %(complete_var)s=bash_complete "$1" 2> /dev/null)
    compopt -o filenames 2> /dev/null
    if [[ ${COMPREPLY[0]-} == *[=.:/] ]]; then compopt -o nospace 2> /dev/null; fi
}
complete -o nosort -F %(complete_func)s %(prog_name)s
"""


@add_completion_class
class _Bash(BashComplete):
    """Completion in bash, which takes a colon or an equals sign for the end of a word."""

    source_template = BASH

    def source(self) -> str:
        """Return the script."""
        return self.source_template % self.source_vars()

    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the words before the one that is being typed, and that."""
        line = os.environ["COMP_LINE"][: int(os.environ["COMP_POINT"])]
        words = split_arg_string(line)
        return (words[1:], "") if line[-1:].isspace() else (words[1:-1], words[-1])

    def complete(self) -> str:
        """Return what may stand in place of what bash takes for the word."""
        typed = self.get_completion_args()[1]
        breaks = [character for character in ":=" if character in os.environ.get("COMP_WORDBREAKS", "")]
        before = max((typed.rfind(character) + 1 for character in breaks), default=0)
        option_value = re.match(r"--[\w-]+=", typed)
        cut = before - (option_value.end() if option_value and option_value.end() <= before else 0)
        lines = super().complete().splitlines()
        return "\n".join(f"{kind},{value[cut:]}" for kind, _, value in (line.partition(",") for line in lines))


for _shell in (ZshComplete, FishComplete):
    add_completion_class(_shell)


@command(example="torquebench completion bash --install")
@argument("shell", type=Choice(SHELLS), help="bash, zsh or fish")
@option("--install", is_flag=True, help="write the script to where the shell looks for it")
def completion(shell: str, install: bool) -> int:
    """Let a shell complete commands, options and values.

    The script that does is printed, or installed.
    """
    found = get_completion_class(shell)
    if found is None:
        raise ConfigError([Problem("SHELL", got=f"'{shell}'")])
    script = found(app, {}, PROGRAM, f"_{ENVIRONMENT}_COMPLETE").source().rstrip("\n")
    tell(shell=shell, script=script)
    if not install:
        say(script, fold=False)
        return 0
    place = Path(PLACES[shell]).expanduser()
    place.parent.mkdir(parents=True, exist_ok=True)
    written = place.with_name(f".{place.name}.new")
    written.write_text(script + "\n", encoding="utf-8")
    written.replace(place)
    tell(installed=place)
    say(f"written: {place}; it works in shells that are started from now on")
    if shell == "zsh":
        say("for zsh, ~/.zshrc needs before compinit: fpath=(~/.zfunc $fpath)")
    return 0


def keys_for(context: click.Context) -> list[str]:
    """Return the keys for ``--set``: those of any config, and those of the one that is on the line already."""
    keys = list(config_keys())
    # click leaves an unfinished line's arguments unread
    for word in [context.params.get("config"), *context.args]:
        with contextlib.suppress(ConfigError):
            keys += _keys_in(find_config(str(word))) if word else []
    return list(dict.fromkeys(keys))


def _keys_in(config: Path) -> list[str]:
    """Return the dotted keys of a config, controllers by name; none of one that cannot be read."""
    import yaml

    try:
        tree = yaml.safe_load(config.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError, RecursionError):
        return []
    found, rest = list[str](), [("", tree)]
    while rest and len(found) < 1000:
        key, value = rest.pop()
        prefix = f"{key}." if key else ""
        if isinstance(value, dict):
            rest += [(f"{prefix}{name}", inner) for name, inner in value.items()]
        elif isinstance(value, list) and value and all(isinstance(part, dict) and "name" in part for part in value):
            rest += [(f"{prefix}{part['name']}", part) for part in value]
        else:
            found.append(key)
    return sorted(found)
