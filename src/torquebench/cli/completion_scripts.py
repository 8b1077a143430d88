"""Completion scripts for bash, zsh and fish: static text, so that the shell asks nobody while one types."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torquebench.cli.completion import Command, Option, Value

BASH = r"""# completion of torquebench in bash, printed by: torquebench completion bash
_torquebench_offer() { # words, ending of files (- for none, @ for folders), what is typed
    local path
    mapfile -t COMPREPLY < <(compgen -W "$1" -- "$3")
    if [[ $2 != - ]]; then
        while IFS= read -r path; do
            if [[ -d $path || ( $2 != @ && $path == *"$2" ) ]]; then COMPREPLY+=("$path"); fi
        done < <(compgen -f -- "$3")
        compopt -o filenames 2> /dev/null
    fi
    if [[ ${COMPREPLY[0]-} == *[=.] ]]; then compopt -o nospace 2> /dev/null; fi
    # bash completes what follows the last of its own word breaks
    if [[ $3 == *:* && $COMP_WORDBREAKS == *:* ]]; then COMPREPLY=("${COMPREPLY[@]#"${3%"${3##*:}"}"}"); fi
}
_torquebench() {
    local line=${COMP_LINE:0:COMP_POINT} typed="" before command="" word
    local -a given
    read -ra given <<< "$line"
    if [[ $line != *[[:space:]] ]]; then
        typed=${given[-1]}
        unset "given[-1]"
    fi
    before=${given[-1]}
    for word in "${given[@]:1}"; do
        if [[ $word != -* ]]; then command=$word; break; fi
    done
    if [[ $typed == --*=* ]]; then before=${typed%%=*} typed=${typed#*=}; fi
    COMPREPLY=()
    case $command in
@COMMANDS@
    esac
}
complete -F _torquebench torquebench"""

ZSH = r"""#compdef torquebench
# completion of torquebench in zsh, printed by: torquebench completion zsh
_torquebench() {
    local curcontext=$curcontext state line
    typeset -A opt_args
    _arguments -C @TOP@ '1:command:->command' '*::argument:->argument'
    case $state in
    command)
        local -a commands=(
@NAMES@
        )
        _describe command commands
        ;;
    argument)
        case $words[1] in
@COMMANDS@
        esac
        ;;
    esac
}
if [[ $funcstack[1] == _torquebench ]]; then _torquebench "$@"; else compdef _torquebench torquebench; fi"""


def bash(commands: Sequence[Command]) -> str:
    """Return the script for bash.

    Args:
        commands: The nameless one first.
    """
    lines = []
    for command in commands:
        lines.append(f"    {command.name or quote('')})")
        lines.append("        case $before in")
        for option in command.options:
            if option.value is not None and not option.optional:
                lines.append(f"        {'|'.join(option.flags)}) {_bash_offer(option.value)}; return ;;")
        lines.append("        esac")
        flags = " ".join(flag for option in command.options for flag in option.flags)
        lines.append(f'        if [[ $typed == -* ]]; then _torquebench_offer {quote(flags)} - "$typed"; return; fi')
        words = " ".join(dict.fromkeys(word for _, value in command.arguments for word in value.words))
        files = next((value.files for _, value in command.arguments if value.files is not None), None)
        lines += [f'        _torquebench_offer {quote(words)} {_bash_files(files)} "$typed"', "        ;;"]
    return BASH.replace("@COMMANDS@", "\n".join(lines))


def _bash_offer(value: Value) -> str:
    return f'_torquebench_offer {quote(" ".join(value.words))} {_bash_files(value.files)} "$typed"'


def _bash_files(files: str | None) -> str:
    return "-" if files is None else {"folders": "@", "": "''"}.get(files, files)


def zsh(commands: Sequence[Command]) -> str:
    """Return the script for zsh.

    Args:
        commands: The nameless one first.
    """
    top, *rest = commands
    names = [f"            {quote(_colons(c.name) + ':' + c.meaning)}" for c in rest]
    lines = []
    for command in rest:
        specs = [spec for option in command.options for spec in _zsh_option(option)]
        for index, (name, value) in enumerate(command.arguments):
            place = "*" if command.many and index == len(command.arguments) - 1 else str(index + 1)
            specs.append(quote(f"{place}:{_colons(name)}:{_zsh_action(value)}"))
        lines += [f"        {command.name})", "            _arguments \\"]
        lines += [f"                {spec} \\" for spec in specs[:-1]] + [
            f"                {specs[-1]}",
            "            ;;",
        ]
    own = " ".join(spec for option in top.options for spec in _zsh_option(option))
    script = ZSH.replace("@TOP@", own).replace("@NAMES@", "\n".join(names))
    return script.replace("@COMMANDS@", "\n".join(lines))


def _zsh_option(option: Option) -> Iterator[str]:
    meaning = "[" + option.meaning.replace("\\", "\\\\").replace("[", "\\[").replace("]", "\\]") + "]"
    for flag in option.flags:
        others = "*" if option.repeats else "(" + " ".join(option.flags) + ")"
        value = "" if option.value is None else f"{'::' if option.optional else ':'}value:{_zsh_action(option.value)}"
        yield quote(f"{others}{flag}{meaning}{value}")


def _zsh_action(value: Value) -> str:
    words = " ".join(_colons(word) for word in value.words)
    keep = " -S ''" if any(word.endswith("=") for word in value.words) else ""
    files = {"folders": "_files -/", "": "_files"}.get(value.files or "", f'_files -g "*{value.files}"')
    if value.files is None:
        return f"{{compadd{keep} -- {words}}}" if words else " "
    return f"{{compadd -- {words}; {files}}}" if words else files


def _colons(text: str) -> str:
    return text.replace(":", "\\:")


def fish(commands: Sequence[Command]) -> str:
    """Return the script for fish.

    Args:
        commands: The nameless one first.
    """
    lines = [
        "# completion of torquebench in fish, printed by: torquebench completion fish",
        "complete -c torquebench -f",
    ]
    for command in commands:
        when = f"-n '__fish_seen_subcommand_from {command.name}'" if command.name else "-n __fish_use_subcommand"
        start = f"complete -c torquebench {when}"
        for option in command.options:
            flags = " ".join(f"-l {flag[2:]}" if flag.startswith("--") else f"-s {flag[1:]}" for flag in option.flags)
            taken = "" if option.value is None or option.optional else f" -x{_fish_value(option.value)}"
            lines.append(f"{start} {flags}{taken} -d {quote(option.meaning, fish=True)}")
        lines += dict.fromkeys(start + _fish_value(value) for _, value in command.arguments if command.name)
        if command.name:
            meaning = quote(command.meaning, fish=True)
            lines.append(f"complete -c torquebench -n __fish_use_subcommand -a {command.name} -d {meaning}")
    return "\n".join(lines)


def _fish_value(value: Value) -> str:
    parts = list(value.words)
    if value.files == "folders":
        parts.append("(__fish_complete_directories)")
    elif value.files is not None:
        parts.append(f"(__fish_complete_suffix {value.files})" if value.files else "(__fish_complete_path)")
    return f" -a {quote(' '.join(parts), fish=True)}" if parts else ""


def quote(text: str, fish: bool = False) -> str:
    """Return `text` as one word of a shell, whatever is in it."""
    return "'" + (text.replace("\\", "\\\\").replace("'", "\\'") if fish else text.replace("'", "'\\''")) + "'"
