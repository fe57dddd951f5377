#!/bin/bash
# make wheel, make wheels: build/wheel/tensormass-VERSION.tar.gz and a wheel per platform, from the sources and the built libraries.
#   python/wheel.sh OUT PYTHON [TARGET...]
# PYTHON: an interpreter with python/requirements.txt. Without a target: the sdist and this machine's wheel of OUT/python-lib, made manylinux by auditwheel. TARGET: the wheel of
# the output of `make cross` in OUT/cross/TARGET; its platform tag is the oldest system for which that was compiled (packaging/cross.sh).
set -euo pipefail
out=$(cd "$1" && pwd) python=$2
shift 2
top=$(cd "$(dirname "$0")/.." && pwd)
PATH=$(dirname "$python"):$PATH
tree=$out/wheel/tree lib=$out/wheel/lib made=$out/wheel/made
# One run at a time; its results replace existing files at the end, so that a concurrent reader never misses them.
mkdir -p "$out/wheel"
exec 9> "$out/wheel/.lock"
flock 9
rm -rf "$made" && mkdir -p "$made"
# Contents of a wheel in the layout of an sdist: the package at the top, the sources of its libraries below.
rm -rf "$tree" && mkdir -p "$tree"
cd "$top"
tar c --exclude=__pycache__ --exclude='*.png' Makefile LICENSE contact_law libtensormass haptic_rt lcm_types python tools | tar x -C "$tree"
mv "$tree"/python/{pyproject.toml,setup.py,MANIFEST.in,README.md,tensormass} "$tree"
cd "$tree"

# replace PATTERN: moves new files in place of existing ones of the same pattern.
replace() {
    for old in "$out"/wheel/$1; do [ -e "$made/${old##*/}" ] || rm -f "$old"; done
    mv -f "$made"/$1 "$out/wheel/"
}

# wheel FOLDER [OPTION...]: makes a wheel of the libraries in $lib, into FOLDER.
wheel() {
    TM_PYTHON_LIB=$lib "$python" - "$@" <<'BUILD'
import sys
from setuptools import build_meta
print(build_meta.build_wheel(sys.argv[1], {"--build-option": sys.argv[2:]} if sys.argv[2:] else None))
BUILD
}

if [ $# -eq 0 ]; then
    rm -rf "$lib"
    "$python" -c 'import sys; from setuptools import build_meta; print(build_meta.build_sdist(sys.argv[1]))' "$made"
    mkdir -p "$lib" && cp "$out"/python-lib/*.so* "$lib"
    for library in "$lib"/*; do # find each other where they lie
        strip --strip-unneeded "$library"
        patchelf --set-rpath '$ORIGIN' "$library"
    done
    wheel "$made/raw"
    auditwheel repair --strip -w "$made" "$made"/raw/*.whl
    replace '*.tar.gz'
    replace "*linux*_$(uname -m).whl"
    auditwheel show "$out"/wheel/*linux*"_$(uname -m).whl"
fi
for target; do
    case $target in
    x86_64-windows) tag=win_amd64 ;;
    aarch64-linux) tag=manylinux_2_28_aarch64 ;;
    aarch64-macos) tag=macosx_11_0_arm64 ;;
    x86_64-macos) tag=macosx_11_0_x86_64 ;;
    *) echo "wheel.sh: $target: no such target; see packaging/cross.sh" >&2; exit 2 ;;
    esac
    rm -rf "$lib" "$tree/build" && mkdir -p "$lib"
    for name in tensormass tensormass_io tensormass_controller; do
        case $target in # under the name by which the others ask for it
        *windows) cp "$out/cross/$target/lib$name.dll" "$lib" ;;
        *) cp -L "$out/cross/$target"/lib$name.so.?.? "$out/cross/$target"/lib$name.?.?.dylib "$lib" 2> /dev/null || true ;;
        esac
        compgen -G "$lib/lib$name.*" > /dev/null || { echo "wheel.sh: $out/cross/$target has no lib$name; run make cross first" >&2; exit 2; }
    done
    wheel "$made" --plat-name "$tag"
    replace "*$tag.whl"
done
rm -rf "$tree" "$lib" "$made"
ls -l "$out"/wheel/*.whl "$out"/wheel/*.tar.gz
