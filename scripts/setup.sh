#!/bin/sh
# Finds Python 3.11 and lets it bring .venv up to date: scripts/setup.sh [step...] (see setup_venv.py).
# PYTHON=/path/to/python3.11 names the interpreter; otherwise it is looked for on PATH.
set -eu
cd "$(dirname "$0")/.."

is_supported() {
    [ "$("$1" -I -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)" = 3.11 ]
}

if [ -n "${PYTHON:-}" ]; then
    if ! is_supported "$PYTHON"; then
        echo "error: PYTHON=$PYTHON does not start Python 3.11; give the path of a Python 3.11 (PyBullet and NumPy have wheels for no other)" >&2
        exit 1
    fi
else
    for candidate in python3.11 python3; do
        if is_supported "$candidate"; then
            PYTHON=$candidate
            break
        fi
    done
    if [ -z "${PYTHON:-}" ]; then
        echo "error: no Python 3.11 on PATH; install python3.11 with its venv and dev packages, or give PYTHON=/path/to/python3.11" >&2
        exit 1
    fi
fi
exec "$PYTHON" -E -s scripts/setup_venv.py "$@"
