#!/usr/bin/env bash
# Sets up weft on Debian 12 or Ubuntu 24.04: the system packages it needs, .venv, and an editable install with
# the tools of the tests. Does nothing where the last set-up still holds. Called by `make demo` and `make test`.
set -euo pipefail
cd "$(dirname "$0")"

stamp=.venv/.set-up
wanted=$(cat setup.sh pyproject.toml voxelize/openvdb_extension/* | sha256sum)
if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ]; then exit 0; fi

python=${PYTHON:-python3}
say() { printf 'setup: %s\n' "$*" >&2; }

# GL for the renderer, OpenVDB for .vdb files, a compiler and Python's headers for the one small extension,
# and Debian's own OpenVDB module, with which the tests read our files independently.
packages="libegl1 libgl1 libgl1-mesa-dri libopenvdb-dev libboost-dev libtbb-dev libimath-dev python3-openvdb"
command -v c++ >/dev/null || packages="$packages g++"
command -v "$python" >/dev/null || packages="$packages python3"
"$python" -c 'import venv, ensurepip' 2>/dev/null || packages="$packages python3-venv"
"$python" -c 'import os, sysconfig; os.stat(sysconfig.get_paths()["include"] + "/Python.h")' 2>/dev/null ||
    packages="$packages python3-dev"

installed() { dpkg-query -W -f '${Status}' "$1" 2>/dev/null | grep -q 'ok installed'; }
missing=""
if command -v dpkg-query >/dev/null; then
    for package in $packages; do installed "$package" || missing="$missing $package"; done
fi
if [ -n "$missing" ]; then
    say "installing system packages:$missing"
    root=""
    [ "$(id -u)" = 0 ] || root=sudo
    if ! { $root apt-get update -qq &&
           $root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing; } >&2; then
        say "could not install them; going on without (weft doctor says what is missing). By hand:"
        say "  sudo apt-get install$missing"
    fi
fi

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    say "Python 3.11 or newer is needed, found $("$python" --version); set PYTHON=/path/to/python3.11"
    exit 2
}
[ -x .venv/bin/python ] || "$python" -m venv .venv
say "installing weft into .venv (about a minute)"
.venv/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
printf '%s' "$wanted" > "$stamp"
say "done"
