"""find_package(tensormass CONFIG) from an empty project after moving the prefix: C and C++, shared and static, versions, components."""
import os
import pathlib
import re
import shutil
import subprocess

import pytest

ENVIRONMENT = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS", "PKG_CONFIG_PATH", "LD_LIBRARY_PATH", "CMAKE_PREFIX_PATH")}

PROJECT = """
cmake_minimum_required(VERSION 3.16)
project(new C CXX)
find_package(tensormass 0.2 CONFIG REQUIRED COMPONENTS solve io scene)
find_package(tensormass 0.2.0 CONFIG REQUIRED)
foreach(kind "" _static)
    add_executable(block${kind} block.c)
    target_link_libraries(block${kind} PRIVATE tensormass::tensormass${kind})
    add_executable(organ${kind} organ.c)
    target_link_libraries(organ${kind} PRIVATE tensormass::io${kind})
    add_executable(models${kind} models.cpp)
    target_link_libraries(models${kind} PRIVATE tensormass::solve${kind})
    add_executable(press${kind} press.c)
    target_link_libraries(press${kind} PRIVATE tensormass::scene${kind})
endforeach()
message(STATUS "found ${tensormass_VERSION} ${tensormass_solve_FOUND} ${tensormass_io_FOUND}")
"""
ASKS = """
cmake_minimum_required(VERSION 3.16)
project(asks NONE)
set(CMAKE_SIZEOF_VOID_P %(pointer)s)
find_package(tensormass %(what)s CONFIG)
message(STATUS "found: ${tensormass_FOUND} ${tensormass_NOT_FOUND_MESSAGE}")
"""


def run(*words, code=0, cwd=None):
    out = subprocess.run([str(w) for w in words], capture_output=True, text=True, env=ENVIRONMENT, timeout=900, cwd=cwd)
    assert out.returncode == code, out.stdout[-4000:] + out.stderr[-4000:]
    return out.stdout + out.stderr


@pytest.fixture(scope="module")
def moved(root, tmp_path_factory):
    """A prefix that was moved after installation, with its libraries where Debian has them."""
    folder = tmp_path_factory.mktemp("cmake")
    run("make", "--no-print-directory", "install-lib", f"PREFIX={folder}/first", f"LIBDIR={folder}/first/lib/x86_64-linux-gnu", cwd=root)
    (folder / "first").rename(folder / "second")
    return folder / "second"


def code(root, number):
    return re.findall(r"^```c\n(.*?)^```", "".join((root / "docs" / page).read_text() for page in ("library-guide.md", "library-api.md", "library-models.md")), re.M | re.S)[number]


def test_an_empty_project_builds_and_runs(root, moved, tmp_path):
    (tmp_path / "CMakeLists.txt").write_text(PROJECT)
    shutil.copy(root / "tests/install/block.c", tmp_path)
    shutil.copy(root / "examples/scene/press.c", tmp_path)
    (tmp_path / "organ.c").write_text(code(root, 2))
    (tmp_path / "models.cpp").write_text(code(root, 1))
    out = run("cmake", "-S", tmp_path, "-B", tmp_path / "b", f"-DCMAKE_PREFIX_PATH={moved}", "-DCMAKE_BUILD_TYPE=", "-G", "Unix Makefiles")
    assert "found 0.2.0 TRUE TRUE" in out
    run("cmake", "--build", tmp_path / "b", "-j2")
    fibres = tmp_path / "fibres.csv"
    fibres.write_text("tet,ax,ay,az\n" + "".join(f"{t},0,1,0\n" for t in range(1134)))
    for kind in ("", "_static"):
        needed = {name: run("readelf", "-d", tmp_path / "b" / (name + kind)) for name in ("block", "organ", "models")}
        assert ("libtensormass.so.0.2" in needed["block"]) == ("libtensormass_io.so.0.2" in needed["organ"]) == ("libtensormass_solve.so.0.2" in needed["models"]) == (not kind)
        run(tmp_path / "b" / f"block{kind}")
        assert "1176 tetrahedra" in run(tmp_path / "b" / f"press{kind}", root / "apps/scenes/block-press.yaml", "haptics")
        assert "1134 tetrahedra" in run(tmp_path / "b" / f"organ{kind}", root / "meshes/cylinder_1k.msh", fibres)
    # A program that depends on solve alone also finds the core; running one model is enough.
    assert "precomputed" in run(tmp_path / "b/models")


@pytest.mark.parametrize("what, pointer, answer", [("", 8, "1"), ("0.2", 8, "1"), ("0.2.0 EXACT", 8, "1"), ("0.3", 8, "0"), ("0.1", 8, "0"), ("0.2.1", 8, "0"), ("1.0", 8, "0"), ("0.2", 4, "0"),
                                                   ("0.2 COMPONENTS nonsense", 8, "0.* has no nonsense; components are solve")])
def test_versions_and_components(moved, tmp_path, what, pointer, answer):
    (tmp_path / "CMakeLists.txt").write_text(ASKS % {"what": what, "pointer": pointer})
    out = run("cmake", "-S", tmp_path, "-B", tmp_path / "b", f"-DCMAKE_PREFIX_PATH={moved}", "-DCMAKE_LIBRARY_ARCHITECTURE=x86_64-linux-gnu")
    words = " ".join(out.split())
    assert re.search(rf"found: {answer[0]}", words) and (len(answer) == 1 or answer[3:] in words), out


def test_no_installed_file_names_the_original_prefix(moved):
    """Searches the files that CMake and the loader use; pkg-config files use their folder."""
    first = str(moved.parent / "first").encode()
    holders = [p for p in moved.rglob("*") if p.is_file() and p.suffix not in (".pc", "") and "installed" not in p.parts and first in p.read_bytes()]
    assert not holders
    assert pathlib.Path(moved / "lib/x86_64-linux-gnu/cmake/tensormass/tensormassConfig.cmake").exists()
