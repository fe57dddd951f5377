#!/bin/bash
# make wheel: build/wheel/tensormass-VERSION.tar.gz and the manylinux wheel, from the sources and the libraries that are built.
#   python/wheel.sh OUT PYTHON     PYTHON: with python/requirements.txt; libraries lie in OUT/python-lib
set -euo pipefail
out=$(cd "$1" && pwd) python=$2
top=$(cd "$(dirname "$0")/.." && pwd)
PATH=$(dirname "$python"):$PATH
tree=$out/wheel/tree
rm -rf "$tree" "$out"/wheel/*.whl "$out"/wheel/*.tar.gz "$out/wheel/raw"
mkdir -p "$tree"
# What a wheel is made of, as an sdist lays it: the package at the top, the sources of its libraries beneath.
cd "$top"
tar c --exclude=__pycache__ --exclude='*.png' Makefile LICENSE law libtensormass haptic_rt lcm_types apps/common apps/sim python tools | tar x -C "$tree"
mv "$tree"/python/{pyproject.toml,setup.py,MANIFEST.in,README.md,tensormass} "$tree"
cd "$tree"
"$python" - <<'BUILD'
from setuptools import build_meta
print(build_meta.build_sdist(".."))
BUILD
# Libraries find each other where they lie.
mkdir -p "$out/wheel/lib" && rm -f "$out"/wheel/lib/* && cp "$out"/python-lib/*.so* "$out/wheel/lib"
for library in "$out"/wheel/lib/*; do
    strip --strip-unneeded "$library"
    patchelf --set-rpath '$ORIGIN' "$library"
done
TM_PYTHON_LIB=$out/wheel/lib "$python" - <<'BUILD'
from setuptools import build_meta
print(build_meta.build_wheel("../raw"))
BUILD
cd "$out/wheel"
auditwheel repair --strip -w . raw/*.whl
rm -rf raw tree lib
auditwheel show ./*.whl
ls -l ./*.whl ./*.tar.gz
