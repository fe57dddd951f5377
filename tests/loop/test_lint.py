"""The core is clean under clang-tidy's cert and bugprone checks and cppcheck, uses no double, no heap and no operating system."""
import os
import re
import subprocess


def test_clang_tidy_and_cppcheck(root):
    run = subprocess.run(["make", "--no-print-directory", "lint-core"], cwd=root, capture_output=True, text=True, timeout=600,
                         env={k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")})
    assert run.returncode == 0, run.stdout + run.stderr


def sources(root):
    return [p for folder in ("core", "can") for p in sorted((root / "haptic_rt" / folder).glob("*.[ch]")) if not p.name.startswith("impulse_engine")]


def test_no_double_no_heap_no_system(root):
    allowed = {"math.h", "stdbool.h", "stddef.h", "stdint.h", "string.h"}
    for path in sources(root):
        text = re.sub(r"/\*.*?\*/|//[^\n]*|\"[^\"\n]*\"", "", path.read_text(), flags=re.S)
        assert not re.search(r"\b(double|malloc|calloc|realloc|free|printf|goto|setjmp)\b", text), path
        assert set(re.findall(r"#include <([^>]+)>", text)) <= allowed, path


def test_symbols_the_core_needs(build):
    """Returns the undefined symbols of libhrt.a that it does not define itself: a few functions of math.h and memset."""
    nm = subprocess.run(["nm", build / "lib/libhrt.a"], capture_output=True, text=True, check=True).stdout
    defined = set(re.findall(r" [TRDBdbrt] (\w+)", nm))
    needed = set(re.findall(r" U (\w+)", nm)) - defined
    sanitizers = {n for n in needed if n.startswith("__")}
    assert needed - sanitizers <= {"sqrtf", "asinf", "atan2f", "fmaxf", "fminf", "fabsf", "memset", "memcpy", "memmove", "_GLOBAL_OFFSET_TABLE_"}, needed


def test_no_recursion(root):
    """Finds functions that call themselves: the recursion that may occur here; clang's call graph would find all."""
    for path in sources(root):
        if path.suffix == ".h":
            continue
        text = path.read_text()
        for match in re.finditer(r"^(?:static )?[\w ]+?\**(\w+)\([^;{]*\) \{\n(.*?)^\}", text, flags=re.S | re.M):
            assert not re.search(rf"\b{match[1]}\(", match[2]), f"{path}: {match[1]} calls itself"
