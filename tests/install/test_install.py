"""`make install`, its parts and `make uninstall`; then programs outside the tree with pkg-config: C, C++, static, under valgrind."""
import json
import os
import re
import shutil
import subprocess

import pytest

ENVIRONMENT = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS", "PKG_CONFIG_PATH", "LD_LIBRARY_PATH")}


def make(root, *words, under=(), code=0, env=ENVIRONMENT):
    run = subprocess.run([*under, "make", "--no-print-directory", *map(str, words)], cwd=root, env=env, capture_output=True, text=True, timeout=900)
    assert run.returncode == code, run.stdout[-4000:] + run.stderr[-4000:]
    return run.stdout + run.stderr


@pytest.fixture(scope="module")
def prefix(root, once):
    return once("prefix", lambda prefix: make(root, "install", f"PREFIX={prefix}"))


def contents(folder):
    """Returns every file and link of a folder, by its path relative to it."""
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_symlink() or not p.is_dir()}


def flags(prefix, *what, package="tensormass", libdir="lib"):
    env = dict(ENVIRONMENT, PKG_CONFIG_PATH=str(prefix / libdir / "pkgconfig"))
    return subprocess.run(["pkg-config", *what, package], env=env, capture_output=True, text=True, check=True).stdout.split()


def build(prefix, root, tmp_path, compiler, *extra):
    source = shutil.copy(root / "tests/install/block.c", tmp_path / ("block.c" if "++" not in compiler else "block.cpp"))
    program = tmp_path / "block"
    subprocess.run([compiler, "-Wall", "-Wextra", "-Werror", source, "-o", program, *flags(prefix, "--cflags", "--libs"), *extra], check=True)
    return program


@pytest.mark.parametrize("compiler", ["gcc", "g++", "clang"])
def test_a_program_outside_the_tree_simulates_a_block(prefix, root, tmp_path, compiler):
    run = subprocess.run([build(prefix, root, tmp_path, compiler)], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    sag, left = run.stdout.split()
    assert -1e-2 < float(sag) < -1e-5, "the block does not sag"
    assert int(left) == 0, "bytes not given back to the allocator hook"
    assert run.stderr == ""


def test_installed_program_is_clean_under_valgrind(prefix, root, tmp_path):
    program = build(prefix, root, tmp_path, "gcc", "-g")
    run = subprocess.run(["valgrind", "--quiet", "--leak-check=full", "--show-leak-kinds=all", "--error-exitcode=9", program],
                         capture_output=True, text=True, timeout=600)
    assert run.returncode == 0, run.stderr
    assert run.stderr == ""


def test_the_core_needs_libc_and_libm_alone_and_exports_its_prefix_alone(prefix):
    library = prefix / "lib/libtensormass.so"
    needed = subprocess.run(["readelf", "-d", library], capture_output=True, text=True, check=True).stdout
    wanted = {line.split("[")[1].rstrip("]") for line in needed.splitlines() if "(NEEDED)" in line}
    assert wanted <= {"libc.so.6", "libm.so.6"}, wanted
    # The second number of the version breaks the interface until 1.0.
    assert "[libtensormass.so.0.2]" in needed and (prefix / "lib/libtensormass.so.0.2").exists()
    solve = subprocess.run(["readelf", "-d", prefix / "lib/libtensormass_solve.so"], capture_output=True, text=True, check=True).stdout
    assert "[libtensormass_solve.so.0.2]" in solve and "[libtensormass.so.0.2]" in solve
    symbols = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout.split("\n")
    foreign = [s.split()[-1] for s in symbols if s and not s.split()[-1].startswith("tm_")]
    assert not foreign, foreign
    imported = subprocess.run(["nm", "-D", "--undefined-only", library], capture_output=True, text=True, check=True).stdout
    for name in ("exit", "_exit", "printf", "puts", "fopen", "write"):
        assert f" {name}@" not in imported, f"the library calls {name}"
    # The default contract handler only prints and aborts.
    objects = subprocess.run(["nm", "-A", "--undefined-only", prefix / "lib/libtensormass.a"], capture_output=True, text=True, check=True).stdout
    loud = {line.split(":")[1] for line in objects.splitlines() if line.split()[-1] in ("abort", "fprintf", "fwrite", "stderr")}
    assert loud == {"base.o"}, loud


def test_installed_programs_run_away_from_the_tree(prefix, tmp_path):
    for program in sorted((prefix / "bin").iterdir()):
        run = subprocess.run([program, "--version"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
        assert run.returncode == 0 and run.stdout.strip(), (program.name, run)


def test_installed_studies_find_their_references_and_scenes(prefix, tmp_path):
    """tm-accuracy finds its CalculiX references and its models' scenes, run from an empty folder."""
    run = subprocess.run([prefix / "bin/tm-accuracy", "--quick", "--knob", "model", "--json", tmp_path / "a.json"], cwd=tmp_path, capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stderr
    model = json.loads((tmp_path / "a.json").read_text())["model"]
    assert len(model["rows"]) > 3 and [p["model"] for p in model["prices"]] == ["tensor/mass", "hybrid", "precomputed"]
    run = subprocess.run([prefix / "bin/tm-accuracy", "--reference", "nowhere.json", "--json", tmp_path / "b.json"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert run.returncode == 2 and "nowhere.json" in run.stderr


# --- contents of the prefix ---


def test_the_prefix_holds_what_a_user_needs(prefix, root):
    share, doc = prefix / "share/tensormass", prefix / "share/doc/tensormass"
    assert (share / "profiles/impulse_engine.profile").exists() and (share / "can/impulse_engine.dbc").exists()
    assert {p.name for p in (share / "lcm_types").iterdir()} == {p.name for p in (root / "lcm_types").glob("*.lcm")}
    assert {"LICENSE", "CHANGELOG.md", "README.md", "examples"} | {p.name for p in (root / "docs").glob("*.md")} <= {p.name for p in doc.iterdir()}
    # An installed profile works with the installed program.
    run = subprocess.run([prefix / "bin/haptic-rt", "--profile", share / "profiles/impulse_engine.profile", "--params"], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0 and "force_max_N" in run.stdout, run.stderr
    unit = (prefix / "lib/systemd/system/haptic-rt@.service").read_text()
    assert f"ExecStart={prefix}/bin/haptic-rt " in unit


def dead_links(doc):
    links = [(page.name, link) for page in sorted(doc.glob("*.md")) for link in re.findall(r"\]\(([^()\s#]+)[^()\s]*\)", page.read_text()) if "://" not in link]
    return [f"{page}: {link}" for page, link in links if not (doc / link).exists()], len(links)


def test_the_prefix_has_no_dead_link(prefix):
    dead, links = dead_links(prefix / "share/doc/tensormass")
    assert links > 100 and not dead, dead


@pytest.mark.parametrize("part", ["install-lib", "install-controller"])
def test_a_part_has_no_dead_link(root, tmp_path, part):
    make(root, part, f"PREFIX={tmp_path}/p")
    dead, links = dead_links(tmp_path / "p/share/doc/tensormass")
    assert links > 5 and not dead, dead


PEER = """
#include <can/codec.h>
#include <hrt.h>
#include <lcm_types/tensormass_force_sample_t.h>
#include <auth.h>
#include <stdio.h>
int main(void) {
    hrt_params params;
    hrt_params_default(&params);
    tensormass_force_sample_t sample = {0};
    printf("%g %d\\n", params.force_max_N, tensormass_force_sample_t_encoded_size(&sample));
    return hrt_params_check(&params) >= 0;
}
"""


def test_peer_can_be_written_in_c_and_python(prefix, build, tmp_path):
    """Controller core, CAN codec and message types, from the prefix only."""
    (tmp_path / "peer.c").write_text(PEER)
    libraries = [w for package in ("tensormass_hrt", "tensormass_lcm") for w in flags(prefix, "--cflags", "--libs", package=package)]
    subprocess.run(["gcc", "-Wall", "-Werror", tmp_path / "peer.c", "-o", tmp_path / "peer", *libraries], check=True)
    limit, size = subprocess.run([tmp_path / "peer"], capture_output=True, text=True, check=True, timeout=120).stdout.split()
    program = "import tensormass_lcm; print(len(tensormass_lcm.force_sample_t().encode()))"
    python = subprocess.run([shutil.which("python3"), "-c", program], env=dict(ENVIRONMENT, PYTHONPATH=str(prefix / "share/tensormass/python")), capture_output=True, text=True)
    assert float(limit) == pytest.approx(8.9) and python.returncode == 0, python.stderr
    assert int(python.stdout) == int(size)


def test_the_readmes_line_links_and_starts(prefix, root, tmp_path):
    """Unchanged except for the prefix: the loader finds the library by itself."""
    page = (root / "README.md").read_text()
    line = re.search(r"^cc .*pkg-config.*$", page, re.M).group(0)
    assert "/opt/tensormass" in line
    shutil.copy(prefix / "share/doc/tensormass/examples/block.c", tmp_path / "simulator.c")
    run = subprocess.run(["sh", "-ec", line.replace("/opt/tensormass", str(prefix))], cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert subprocess.run([tmp_path / "simulator"], env=ENVIRONMENT, capture_output=True, timeout=300).returncode == 0


# --- parts, places, and uninstalling ---


def test_uninstall_takes_what_was_installed_and_nothing_else(root, tmp_path):
    prefix, libdir = tmp_path / "usr", "lib/x86_64-linux-gnu"
    (prefix / "share/doc").mkdir(parents=True)
    (prefix / "share/doc/theirs.txt").write_text("theirs")
    where = [f"DESTDIR={tmp_path}/image", f"PREFIX={prefix}", f"LIBDIR={prefix}/{libdir}"]
    image = tmp_path / "image" / prefix.relative_to("/")
    make(root, "install-lib", *where)
    assert not contents(prefix) - {"share/doc/theirs.txt"}, "written past DESTDIR"
    installed = contents(image)
    assert {f"{libdir}/libtensormass.so", f"{libdir}/pkgconfig/tensormass.pc", "include/tensormass.h"} <= installed
    assert not any(p.startswith("lib/lib") for p in installed)
    assert f"libdir={prefix}/{libdir}\n" in (image / libdir / "pkgconfig/tensormass.pc").read_text()
    # A file of the user's among ours, and one of an older version.
    (image / "include/tensormass/theirs.h").write_text("theirs")
    (image / "include/tensormass/gone.h").write_text("of an older version")
    with open(image / "share/tensormass/installed/install-lib", "a") as listed:
        listed.write(f"{prefix}/include/tensormass/gone.h\n")
    make(root, "install-lib", *where)
    assert contents(image) == installed | {"include/tensormass/theirs.h"}
    make(root, "uninstall", *where)
    assert contents(image) == {"include/tensormass/theirs.h"}
    assert not (image / libdir).exists() and not (image / "share").exists()
    assert "nothing of tensormass" in make(root, "uninstall", *where, code=2)
    # Directly into an existing prefix: it stays, with its other files.
    make(root, "install-lib", f"PREFIX={prefix}")
    make(root, "uninstall", f"PREFIX={prefix}")
    assert contents(prefix) == {"share/doc/theirs.txt"}
    assert "give paths from / on" in make(root, "install-lib", "PREFIX=here", code=2)


def test_a_system_prefix_gets_no_run_path(root, tmp_path):
    make(root, "install-lib", f"DESTDIR={tmp_path}", "PREFIX=/usr")
    assert "rpath" not in (tmp_path / "usr/lib/pkgconfig/tensormass.pc").read_text()


# Absent are headers and tools of other parts; the library does not need those of the controller either.
PROGRAMS_NEED = ["/usr/include/SDL2", "/usr/include/GL", "/usr/include/suitesparse", "/usr/include/eigen3",
                 "/usr/include/yaml.h", "/usr/include/png.h", "/usr/include/libpng16", "/usr/bin/mpicc"]
CONTROLLER_NEEDS = ["/usr/include/lcm", "/usr/include/cjson", "/usr/bin/lcm-gen"]
HIDE = 'for p in $HIDDEN; do if [ -d $p ]; then mount -t tmpfs none $p; elif [ -e $p ]; then mount --bind /dev/null $p; fi; done; exec "$@"'


def without(hidden):
    """Commands that hide tools, to simulate a machine without them."""
    under = ["unshare", "-m" if os.geteuid() == 0 else "-rm", "env", f"HIDDEN={' '.join(hidden)}", "sh", "-ec", HIDE, "sh"]
    if subprocess.run([*under, "true"], capture_output=True).returncode:
        pytest.skip("mount namespaces are not permitted here")
    return under


# In place of a compiler: a source is preprocessed, which needs all its headers; its object is that of the build, if there is one. All else is as it is.
PREPROCESSES = """#!/bin/bash
PATH=${PATH#*:}
for ((i = 1; i <= $#; i++)); do [ "${!i}" = -o ] && j=$((i + 1)) && out=${!j}; done
made=BUILD/obj/${out#*/build/obj/}
if [[ " $* " != *" -c "* || ! -s $made ]]; then exec REAL "$@"; fi
REAL "$@" -E && cp "$made" "$out"
"""


def preprocessing(build, folder):
    """Returns an environment in which such compilers are found first."""
    folder.mkdir()
    for name in ("gcc", "g++"):
        (folder / name).write_text(PREPROCESSES.replace("BUILD", str(build)).replace("REAL", shutil.which(name)))
        (folder / name).chmod(0o755)
    return dict(ENVIRONMENT, PATH=f"{folder}:{ENVIRONMENT['PATH']}")


def test_library_and_controller_build_alone(root, build, tmp_path):
    """Each part on a machine that has exactly its dependencies."""
    place = [f"BUILD={tmp_path}/build", f"PREFIX={tmp_path}/prefix", "-j2"]
    env = preprocessing(build, tmp_path / "compilers")
    make(root, "install-lib", *place, under=without(PROGRAMS_NEED + CONTROLLER_NEEDS), env=env)
    installed = contents(tmp_path / "prefix")
    assert "lib/libtensormass.so" in installed and not any("solve" in p for p in installed if not p.startswith("share/doc/"))
    assert {p.name for p in (tmp_path / "build/lib").iterdir()} == {p.split("/")[-1] for p in installed if p.startswith("lib/lib")}, "more was built"
    make(root, "install-controller", *place, under=without(PROGRAMS_NEED), env=env)
    assert {p.name for p in (tmp_path / "prefix/bin").iterdir()} == {"haptic-rt", "tm-device"} == {p.name for p in (tmp_path / "build/bin").iterdir()}
    assert subprocess.run([tmp_path / "prefix/bin/haptic-rt", "--version"], capture_output=True, timeout=120).returncode == 0
    make(root, "uninstall", f"PREFIX={tmp_path}/prefix")
    assert not (tmp_path / "prefix").exists()
