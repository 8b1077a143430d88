"""Odd environments: what is missing, closed, read-only, narrow, full, or spelt as nobody would."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from trust.rows import row
from trust.workshop import Workshop, differing, tree

import torquebench

ODD = "a b\n'é\"$x;\u202f日本"
"""Name of a folder."""
TERMINAL = "import os, pty, sys; sys.exit(os.waitstatus_to_exitcode(pty.spawn(sys.argv[1:])))"
SHELL = {
    "no HOME": 'unset HOME; exec "$@"',
    "a read-only HOME": 'HOME=/proc exec "$@"',
    "a HOME that is not there": 'HOME=/nowhere/at/all XDG_CACHE_HOME= exec "$@"',
    "the C locale, no UTF-8": 'LC_ALL=C LANG=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0 exec "$@"',
    "ASCII streams": 'PYTHONIOENCODING=ascii:strict exec "$@"',
    "a Turkish locale": 'LC_ALL=tr_TR.UTF-8 exec "$@"',
    "a dumb terminal": 'TERM=dumb "$0" -c "$TERMINAL" "$@"',
    "no TERM": 'unset TERM; "$0" -c "$TERMINAL" "$@"',
    "a terminal of 80 columns": 'COLUMNS=80 LINES=24 "$0" -c "$TERMINAL" "$@"',
    "a terminal of 20 columns": 'COLUMNS=20 LINES=3 "$0" -c "$TERMINAL" "$@"',
    "a terminal of one column": 'COLUMNS=1 LINES=1 "$0" -c "$TERMINAL" "$@"',
    "columns that are no number": 'COLUMNS=wide LINES=-3 "$0" -c "$TERMINAL" "$@"',
    "closed stdin": 'exec "$@" <&-',
    "closed stdout": 'exec "$@" >&-',
    "closed stderr": 'exec "$@" 2>&-',
    "all closed": 'exec "$@" <&- >&- 2>&-',
    "a full stdout": 'exec "$@" >/dev/full',
    "a stdout nobody reads": '{ "$@"; echo $? >"$STATUS"; } | true; exit "$(cat "$STATUS")"',
    "warnings as errors": 'PYTHONWARNINGS=error exec "$@"',
    "development mode": 'PYTHONDEVMODE=1 exec "$@"',
    "no OpenGL": 'MUJOCO_GL=egl PYOPENGL_PLATFORM=egl __EGL_VENDOR_LIBRARY_FILENAMES=/nowhere exec "$@"',
    "a bad time zone": 'TZ=Nowhere/Bad exec "$@"',
    "umask 077": 'umask 077; exec "$@"',
    "umask 000": 'umask 000; exec "$@"',
    "a hash seed": 'PYTHONHASHSEED=4294967295 exec "$@"',
    "no docstrings or asserts": 'PYTHONOPTIMIZE=2 exec "$@"',
    "no bytecode": 'PYTHONDONTWRITEBYTECODE=1 exec "$@"',
    "a safe path": 'PYTHONSAFEPATH=1 exec "$@"',
    "no TMPDIR": 'TMPDIR=/nowhere exec "$@"',
    "matplotlib's folder read-only": 'MPLCONFIGDIR=/proc/x exec "$@"',
    "a read-only cache": 'NUMBA_CACHE_DIR=/proc/x exec "$@"',
    "24 open files": 'ulimit -n 24; exec "$@"',
    "a read-only current folder": 'cd /proc; exec "$@"',
    "a current folder that is gone": 'mkdir "$GONE"; cd "$GONE"; rmdir "$GONE"; exec "$@"',
    "an odd current folder": 'mkdir -p "$ODD"; cd "$ODD"; exec "$@"',
    "an empty PATH": 'PATH= exec "$@"',
}
"""What is odd -> how a shell runs the line "$@" there; "$0" is Python."""
UNREAD = {"a full stdout": (3,), "a stdout nobody reads": (0, 141)}
"""Exit statuses where nobody can read what is printed; 0 elsewhere."""


@row("environments", "In an odd environment a command leaves the same bytes, or says in words what it lacks.", 4, 144)
def attack_surroundings(shop: Workshop, tries: int) -> Iterator[str]:
    """No HOME, read-only folders, odd locales, closed streams, narrow terminals, warnings as errors, odd paths."""
    wanted, names = tree(shop.run), list(SHELL)
    shop.random.shuffle(names)
    for number in range(tries):
        name, kind = names[number % len(names)], "run report list doctor".split()[number // len(names) % 4]
        if tries < len(names):
            kind = "run"
        where = shop.absent("odd") / (ODD if number % 2 else "plain")
        where.mkdir(parents=True)
        config, out = where / "short.yaml", where / "out"
        shutil.copy(shop.config, config)
        lines = {"run": ["run", config, "--out", out], "list": ["list"], "doctor": ["doctor"]}
        lines["report"] = ["report", shop.run, "--out", where / "page.html"]
        done = _run(name, where, [str(word) for word in lines[kind]])
        text = done.stdout + done.stderr
        allowed = UNREAD.get(name, (0,))
        found = ""
        if done.returncode not in allowed or "Traceback" in text or "internal error" in text:
            found = f"exit status {done.returncode}: {text.strip()[-300:]}"
        elif kind == "run" and (apart := differing(wanted, tree(out))):
            found = f"other bytes in {', '.join(apart[:3])}"
        yield f"{kind} with {name}{', at an odd path' if number % 2 else ''}: {found}" if found else ""


def _run(name: str, where: Path, line: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a line of the command line by a shell in one of the environments."""
    paths = {"STATUS": where / "status", "GONE": where / "gone", "ODD": where / ODD}
    paths["PYTHONPATH"] = Path(torquebench.__file__).parents[1]  # this checkout's, wherever the line is run
    inside = {key: str(path) for key, path in paths.items()} | {"TERMINAL": TERMINAL}
    words = ["sh", "-c", SHELL[name], sys.executable, sys.executable, "-m", "torquebench", *line]
    return subprocess.run(
        words, env=os.environ | inside, check=False, capture_output=True, text=True, errors="replace", timeout=600
    )
