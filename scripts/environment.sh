# Sourced by scripts/torquebench and scripts/test: makes ./.venv from a lock file when it is missing or stale.
# Usage: . scripts/environment.sh LOCKFILE   (sets $root and $python)

root=$(CDPATH= cd -- "$(dirname -- "$(readlink -f -- "$0")")/.." && pwd)
python="$root/.venv/bin/python"

say() { printf '%s\n' "$*" >&2; }

find_python() {
    for candidate in ${PYTHON:-} python3 python3.14 python3.13 python3.12 python3.11; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then
            printf '%s' "$candidate"
            return 0
        fi
    done
    return 1
}

make_environment() {
    lock="$root/$1"
    stamp="$root/.venv/.torquebench-$1"
    # the path counts: a copied checkout would otherwise go on using the package of the original
    wanted=$({ printf '%s\n' "$root"; cat "$lock" "$root/pyproject.toml"; } | cksum)
    [ -x "$python" ] && [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ] && return 0
    say "torquebench: setting up $root/.venv (once; packages as pinned in $1)"
    # Left alone, Python keeps the bytecode of the sixth of all modules that get imported; forbidden to, it wants all now.
    compile=${PYTHONDONTWRITEBYTECODE:+yes}
    if command -v uv >/dev/null 2>&1; then
        [ -x "$python" ] || uv venv --quiet --python '>=3.11' "$root/.venv" || return 1
        install() { uv pip install --quiet --python "$python" ${compile:+--compile-bytecode} --no-deps "$@"; }
    else
        base=$(find_python) || { say "torquebench: needs Python 3.11 or newer (set PYTHON=/path/to/python3)"; return 1; }
        [ -x "$python" ] || "$base" -m venv "$root/.venv" || {
            say "torquebench: could not make a virtual environment (on Debian or Ubuntu: apt-get install python3-venv)"
            return 1
        }
        bytecode=--no-compile
        [ -z "$compile" ] || bytecode=--compile
        install() { "$python" -m pip install --quiet --disable-pip-version-check $bytecode --no-deps "$@"; }
    fi
    install --require-hashes -r "$lock" && install --no-build-isolation -e "$root" || return 1
    printf '%s' "$wanted" >"$stamp"
}

make_environment "$1" || { say "torquebench: the environment could not be set up"; exit 3; }
