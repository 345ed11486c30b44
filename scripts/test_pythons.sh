#!/bin/bash
# Runs the tests on every supported Python that is found, on PATH or under pyenv: scripts/test_pythons.sh [pytest options].
# Each has its own checkout of the last commit and its own environment in build/pythons, which later calls update.
set -u
cd "$(dirname "$0")/.."
if [ -n "${VIRTUAL_ENV-}" ]; then
    echo "error: $VIRTUAL_ENV is sourced in this shell, and the tests would find its package; start this in a new shell." >&2
    exit 2
fi

find_python() {
    local found
    for found in "python$1" "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$1".*/bin/python; do
        if [ "$("$found" -I -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)" = "$1" ]; then
            command -v "$found"
            return
        fi
    done
    return 1
}

failed=0
for version in 3.11 3.12 3.13; do
    if ! python=$(find_python "$version"); then
        echo "== Python $version: not found"
        continue
    fi
    copy=build/pythons/$version
    if [ -d "$copy" ]; then
        git -C "$copy" fetch -q origin HEAD && git -C "$copy" checkout -q --detach FETCH_HEAD
    else
        git clone -q . "$copy"
    fi || exit 1
    echo "== Python $version: $python"
    make -C "$copy" test PYTHON="$python" WORKERS="${WORKERS:-2}" ARGS="${*@Q}" || failed=1
done
echo "== the same seed on all of them"
(. .venv/setup.bash && python -m pytest -q test/packaging/test_pythons.py) || failed=1
exit $failed
