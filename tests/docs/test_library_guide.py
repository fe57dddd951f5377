"""The example of docs/library-guide.md compiles without a warning as C and as C++, and does what it says."""
import re
import subprocess

import pytest


@pytest.mark.parametrize("compiler", [["gcc", "-std=c11"], ["g++", "-std=c++17", "-x", "c++"]], ids=["C", "C++"])
def test_example_compiles_and_runs(root, build, tmp_path, compiler):
    code = re.search(r"^```c\n(.*?)^```", (root / "docs" / "library-guide.md").read_text(), re.M | re.S).group(1)
    source = tmp_path / "block.c"
    source.write_text(code)
    program = tmp_path / "block"
    subprocess.run([*compiler, "-Wall", "-Wextra", "-Werror", f"-I{root}/libtensormass/include", source, "-x", "none", build / "lib" / "libtensormass.a", "-lm",
                    "-o", program], check=True, timeout=120)
    run = subprocess.run([program], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0 and run.stderr == ""
    borne = float(re.search(r"bears ([0-9.]+) N", run.stdout).group(1))
    assert borne == pytest.approx(1060 * 1e-6 * 9.81, rel=1e-3)
