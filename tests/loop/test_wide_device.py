"""A device with more joints than the CAN bus carries: rejected if a bus is opened for it, simulated otherwise. The programs are linked again with
such a device in their table and are otherwise unchanged."""
import os
import re
import shlex
import shutil
import subprocess

import pytest
from paths import BUILD, ROOT

PROGRAMS = ("haptic-rt", "tm-device", "tm-sim")
SAYS = "a wide has 6 joints, and the CAN frames carry 5"


def run(*argv, code=0):
    done = subprocess.run([str(a) for a in argv], cwd=ROOT, capture_output=True, text=True, timeout=300,
                          env={k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")})
    assert done.returncode == code, done.stderr
    return done


def add_row(core):
    """Makes `wide`: the desk device with three more joints."""
    desk = (core / "device_desk.h").read_text()
    joint = re.search(r'JOINT\("z_m"[^)]*\)', desk).group(0)
    more = ", ".join(joint.replace("z_m", name) for name in ("z_m", "a_m", "b_m", "c_m"))
    (core / "device_wide.h").write_text(desk.replace(joint, more).replace(".joints = 3", ".joints = 6").replace("desk", "wide"))
    table = (core / "device_types.h").read_text()
    table = table.replace('#include "device_desk.h"\n', '#include "device_desk.h"\n#include "device_wide.h"\n').replace("ROW(desk)", "ROW(desk) ROW(wide)")
    (core / "device_types.h").write_text(table)


@pytest.fixture(scope="module")
def wide(once):
    """Returns the folder of the programs."""
    def build(out):
        for folder in ("haptic_rt/core", "haptic_rt/motion"):
            shutil.copytree(ROOT / folder, out / folder)
        add_row(out / "haptic_rt/core")
        objects = []
        for folder in ("core", "motion"):
            objects.append(out / f"{folder}.o")
            run("gcc", "-std=gnu11", "-O1", "-w", f"-I{out}", f"-I{out / 'haptic_rt'}", f"-I{out / 'haptic_rt/core'}", f"-I{ROOT}", "-c",
                out / f"haptic_rt/{folder}/kinematics.c", "-o", objects[-1])
        config = BUILD.name if BUILD.name in ("debug", "asan", "tsan", "fuzz", "clang") else "release"
        where = os.path.relpath(BUILD if config == "release" else BUILD.parent, ROOT)
        for name in PROGRAMS:
            target = os.path.relpath(BUILD / "bin" / name, ROOT)
            recipe = run("make", "-n", f"config={config}", f"BUILD={where}", "-W", "haptic_rt/core/kinematics.c", target).stdout
            link = next(line for line in recipe.splitlines() if f" -o {target} " in line)
            run(*shlex.split(link.replace(f" -o {target} ", f" -o {out / name} {objects[0]} {objects[1]} ")))
    return once("wide-device", build)


@pytest.mark.parametrize("program", ["haptic-rt", "tm-device"])
def test_wide_device_on_a_bus_is_rejected(wide, program):
    assert SAYS in run(wide / program, "--bus", "virtual:wide", "--duration", "0.1", "--device-type", "wide", code=2).stderr


def scene(wide, tmp_path, *words, code=0):
    return run(wide / "tm-sim", "apps/scenes/block-press.yaml", "--lockstep", "--quiet", "--frames", "2", "--set", "instruments[0].device=wide",
               "--csv", tmp_path / "t.csv", *words, code=code)


def test_wide_device_in_lockstep_with_a_bus_is_rejected(wide, tmp_path):
    stderr = scene(wide, tmp_path, "--set", "haptics.sends=force", code=2).stderr
    assert "--set instruments[0].device=wide: instrument 0: " + SAYS in stderr, stderr
    assert not (tmp_path / "t.csv").exists()


def test_wide_device_without_a_bus_is_simulated(wide, tmp_path):
    scene(wide, tmp_path, "--unset", "haptics")
    assert "x_m,y_m,z_m,a_m,b_m,c_m,age_s" in (tmp_path / "t.csv").read_text().splitlines()[0]
