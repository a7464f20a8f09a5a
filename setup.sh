#!/usr/bin/env bash
# Sets up weft on Debian 12 or Ubuntu 24.04: the system packages it needs, .venv, and an editable install with
# the tools of the tests. Does nothing where the last set-up still holds. Called by `make demo` and `make test`.
set -euo pipefail
cd "$(dirname "$0")"

python=${PYTHON:-python3}
say() { printf 'setup: %s\n' "$*" >&2; }

# GL for the renderer, OpenVDB for .vdb files, a compiler and Python's headers for the one small extension,
# Debian's own OpenVDB module, with which the tests read our files independently, and for the tests a second
# OpenGL driver (zink over lavapipe) and Khronos' reference compiler of GLSL.
packages="libegl1 libgl1 libgl1-mesa-dri libopenvdb-dev libboost-dev libtbb-dev libimath-dev python3-openvdb
    mesa-vulkan-drivers glslang-tools"
command -v c++ >/dev/null || packages="$packages g++"
command -v "$python" >/dev/null || packages="$packages python3"
"$python" -c 'import venv, ensurepip' 2>/dev/null || packages="$packages python3-venv"
"$python" -c 'import os, sysconfig; os.stat(sysconfig.get_paths()["include"] + "/Python.h")' 2>/dev/null ||
    packages="$packages python3-dev"

installed() { dpkg-query -W -f '${Status}' "$1" 2>/dev/null | grep -q 'ok installed'; }
find_missing() {
    missing=""
    command -v dpkg-query >/dev/null || return 0
    for package in $packages; do installed "$package" || missing="$missing $package"; done
}

# What is missing belongs to the stamp: who installs it by hand later gets weft built anew, with it.
stamp=.venv/.set-up
packages_of_weft=$(find . -path ./.venv -prune -o -name __init__.py -print | sort)
sources=$({ cat setup.sh pyproject.toml voxelize/CMakeLists.txt voxelize/*_extension/*; echo "$packages_of_weft"; } | sha256sum)
find_missing
if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$sources$missing" ]; then exit 0; fi

if [ -n "$missing" ]; then
    say "installing system packages:$missing"
    root=""
    [ "$(id -u)" = 0 ] || root=sudo
    install() {
        $root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >&2
    }
    $root apt-get update -qq >&2 || true
    # One by one where not all can be had: apt takes none of a list of which it does not know one.
    install $missing || for package in $missing; do install "$package" || true; done
    find_missing
    if [ -n "$missing" ]; then
        say "could not install$missing; going on without (weft doctor says what that means). By hand:"
        say "  sudo apt-get install$missing"
    fi
fi

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    say "Python 3.11 or newer is needed, found $("$python" --version); set PYTHON=/path/to/python3.11"
    exit 2
}
.venv/bin/python -m pip --version >/dev/null 2>&1 || "$python" -m venv --clear .venv
say "installing weft into .venv (about a minute)"
.venv/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
printf '%s' "$sources$missing" > "$stamp"
say "done"
