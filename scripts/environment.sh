# Sourced by the scripts beside it: makes ./.venv from a lock file when it is missing or stale.
# Usage: . scripts/environment.sh LOCKFILE   (sets $root, $python, $made if it did, and install)

root=$(CDPATH= cd -- "$(dirname -- "$(readlink -f -- "$0")")/.." && pwd)
python="$root/.venv/bin/python"
# Bytecode is kept in ./.venv and beside the sources here, which git ignores: without it each start costs 3 s more.
unset PYTHONDONTWRITEBYTECODE

say() { printf '%s\n' "$*" >&2; }

# step WHAT COMMAND...: tells what is done, on a terminal each second for how long; what it prints is shown if it fails.
step() {
    what=$1
    printf '%s ... ' "$what" >&2
    shift
    begun=$(date +%s)
    ticking=
    if [ -t 2 ]; then
        # Ctrl-C does not reach what runs in the background: it looks whether this script is still there
        while sleep 1 && kill -0 $$ 2>/dev/null; do printf '\r%s ... %s s ' "$what" $(($(date +%s) - begun)) >&2; done >/dev/null &
        ticking=$!
    fi
    printed=$("$@" 2>&1)
    failed=$?
    if [ -n "$ticking" ]; then
        { kill "$ticking" && wait "$ticking"; } 2>/dev/null
        printf '\r%s ... ' "$what" >&2
    fi
    if [ "$failed" = 0 ]; then
        say "done in $(($(date +%s) - begun)) s"
    else
        say "FAILED after $(($(date +%s) - begun)) s"
        say "$printed"
        return 1
    fi
}

# What to do where packages could not be installed.
advise() {
    say "torquebench: not everything could be installed; what is above says why."
    say "  Without a network: docs/installing.md, \"Without a network\". With a mirror or a proxy: PIP_INDEX_URL, HTTPS_PROXY."
    say "  Without pip: apt-get install python3-pip on Debian or Ubuntu, or PYTHON=/path/to/python3 of one that has it."
    say "  Disk full: $root/.venv takes 0.8 GB, with all for the tests 1.8 GB. The same command goes on from here."
}

# The Python outside of ./.venv: where that is activated, python3 is its own, which has no pip.
find_python() {
    for candidate in ${PYTHON:-} python3 python3.14 python3.13 python3.12 python3.11; do
        "$candidate" - "$root/.venv" 2>/dev/null <<'END' && return 0
import os, sys
if sys.version_info < (3, 11):
    sys.exit(1)
inside = os.path.realpath(sys.prefix) == os.path.realpath(sys.argv[1])
print(sys._base_executable if inside else sys.executable)
END
    done
    say "torquebench: needs Python 3.11 or newer, or uv, which fetches one (set PYTHON=/path/to/python3 if it is elsewhere)"
    return 1
}

# Pip 22.3 and later install into another environment, which then needs none of its own: that saves 6 s.
has_pip() { "$1" -c 'import pip, sys; sys.exit(tuple(map(int, pip.__version__.split(".")[:2])) < (22, 3))' 2>/dev/null; }

make_venv() {
    rm -rf "$root/.venv"
    if command -v uv >/dev/null 2>&1; then
        uv venv --quiet --python '>=3.11' "$root/.venv"
    elif has_pip "$base"; then
        "$base" -m venv --without-pip "$root/.venv"
    else
        "$base" -m venv "$root/.venv" || { say "On Debian or Ubuntu: apt-get install python3-venv, or python3-pip"; return 1; }
    fi
}

install() {
    if command -v uv >/dev/null 2>&1; then
        # without a network uv looks into its cache only if told to
        uv pip install --quiet --python "$python" "$@" || uv pip install --quiet --python "$python" --offline "$@" 2>/dev/null
    else
        set -- --quiet --disable-pip-version-check --no-compile "$@"
        pip install "$@" && return 0
        # without a network pip asks its cache for files, but nobody for their names
        wheels="$root/.venv/wheels"
        "$python" "$root/scripts/cached_wheels.py" "$(pip cache dir)" "$root/requirements-dev.lock" "$wheels" &&
            pip install --no-index --find-links "$wheels" "$@"
    fi
}

pip() {
    if has_pip "$python"; then PIP_USER=0 "$python" -m pip "$@"; else PIP_USER=0 "$base" -m pip --python "$python" "$@"; fi
}

# What install needs: the Python outside of ./.venv, where there is no uv.
base=
need_base() { command -v uv >/dev/null 2>&1 || base=$(find_python); }

make_environment() {
    lock="$root/$1"
    stamp="$root/.venv/.torquebench-$1"
    # the path counts: a copied checkout would otherwise go on using the package of the original
    wanted=$({ printf '%s\n' "$root"; cat "$lock" "$root/pyproject.toml"; } | cksum)
    [ -x "$python" ] && [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ] && return 0
    need_base || return 1
    say "torquebench: setting up $root/.venv, once (packages as pinned in $1)"
    [ -x "$python" ] || make_venv >&2 || { say "torquebench: no virtual environment could be made in $root"; return 1; }
    case $1 in *-dev*) size="about 500 MB, 1 to 2 minutes" ;; *) size="about 230 MB, 20 to 60 s" ;; esac
    if ! step "1/2 packages ($size)" install --no-deps --require-hashes -r "$lock" ||
        ! step "2/2 torquebench itself (2 s)" install --no-deps --no-build-isolation -e "$root"; then
        advise
        return 1
    fi
    printf '%s' "$wanted" >"$stamp"
    made=yes
}

made=
make_environment "$1" || { say "torquebench: the environment could not be set up"; exit 3; }
