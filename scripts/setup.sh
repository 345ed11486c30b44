#!/bin/sh
# Finds a Python and lets it bring .venv up to date: scripts/setup.sh [step...] (see setup_venv.py).
# PYTHON=/path/to/python names the interpreter; otherwise it is that of .venv, or else one on
# PATH: 3.11 if it is there, for which every package has a wheel, or the newest supported one.
set -eu
cd "$(dirname "$0")/.."

version() {
    "$1" -I -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null
}

is_supported() {
    case "$(version "$1")" in
        3.11 | 3.12 | 3.13) ;;
        *) return 1 ;;
    esac
}

if [ -n "${PYTHON:-}" ]; then
    if ! is_supported "$PYTHON"; then
        found=$(version "$PYTHON" || true)
        echo "error: PYTHON=$PYTHON ${found:+is Python $found and }does not fit; give the path of a Python 3.11, 3.12 or 3.13" >&2
        exit 1
    fi
else
    home=
    if [ -f .venv/pyvenv.cfg ]; then
        while read -r key _ value; do
            [ "$key" != home ] || home=$value
        done <.venv/pyvenv.cfg
    fi
    for candidate in ${home:+"$home/python3"} python3.11 python3.13 python3.12 python3; do
        if is_supported "$candidate"; then
            PYTHON=$candidate
            break
        fi
    done
    if [ -z "${PYTHON:-}" ]; then
        echo "error: no Python 3.11, 3.12 or 3.13 on PATH; install one with its venv and dev packages (Ubuntu: sudo apt install python3-venv python3-dev), or give PYTHON=/path/to/python" >&2
        exit 1
    fi
fi
exec "$PYTHON" -E -s scripts/setup_venv.py "$@"
