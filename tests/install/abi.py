"""Prints the C interface: exported functions and data of the libraries, sizes of public structs. test_abi.py compares the list.

    build/venv/bin/python tests/install/abi.py > tests/install/abi.txt"""
import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
LIBRARIES = ["libtensormass.so", "libtensormass_solve.so", "libtensormass_io.so", "libtensormass_scene.so"]
HEADERS = ["libtensormass/include", "libtensormass/io/include", "libtensormass/scene/include"]


def soversion():
    numbers = re.search(r"^VERSION := (\S+)$", (ROOT / "Makefile").read_text(), re.M)[1].split(".")
    return ".".join(numbers[:2] if numbers[0] == "0" else numbers[:1])


def symbols(build):
    for library in LIBRARIES:
        listed = subprocess.run(["nm", "-D", "--defined-only", build / "lib" / library], capture_output=True, text=True, check=True).stdout
        for line in listed.splitlines():
            kind, name = line.split()[-2:]
            if name.startswith("tm_"):
                yield f"{library.removesuffix('.so')} {'data' if kind in 'BDR' else 'function'} {name}"


def structs():
    names = sorted(set(re.findall(r"^\} (tm_\w+);$", "\n".join(h.read_text() for include in HEADERS for h in (ROOT / include).rglob("*.h")), re.M)))
    lines = "".join(f'    printf("size {n} %zu\\n", sizeof({n}));\n' for n in names)
    with tempfile.TemporaryDirectory() as folder:
        source = pathlib.Path(folder) / "sizes.c"
        source.write_text('#include <stdio.h>\n#include "tensormass_solve.h"\n#include "tensormass_io.h"\n#include "tensormass_scene.h"\n#include "tensormass.h"\nint main(void) {\n' + lines + "    return 0;\n}\n")
        subprocess.run(["cc", "-std=c11", *(f"-I{ROOT / include}" for include in HEADERS), source, "-o", source.with_suffix("")], check=True)
        return subprocess.run([source.with_suffix("")], capture_output=True, text=True, check=True).stdout.splitlines()


def interface(build):
    return [f"soversion {soversion()}", *sorted(symbols(build)), *structs()]


if __name__ == "__main__":
    print("\n".join(interface(pathlib.Path(os.environ.get("TM_OUT", sys.argv[1] if len(sys.argv) > 1 else ROOT / "build")))))
