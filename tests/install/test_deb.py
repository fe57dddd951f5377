"""`make deb`: packages are built, checked by lintian, and installed, used and purged in a separate system."""
import os
import pathlib
import re
import shutil
import subprocess

import pytest

pytestmark = pytest.mark.long  # needs tools to build packages, and a Debian to install them in

USED = r"""
set -ex
export DEBIAN_FRONTEND=noninteractive
find / -xdev ! -path '/proc/*' ! -path '/sys/*' ! -path '/tmp/*' | sort > /tmp/before
apt-get install -y -q --no-install-recommends /tmp/debs/*.deb gcc libc6-dev pkg-config
cd /tmp
# Programs, a scene of the package, the module that links CHOLMOD.
tm-mesh check /usr/share/tensormass/meshes/liver_1k.msh
cp -r /usr/share/tensormass /tmp/mine
tm-sim --lockstep /tmp/mine/apps/scenes/block-gravity.yaml --duration '0.1 s'
tm-sim --lockstep /tmp/mine/apps/scenes/evaluate-precomputed.yaml --duration '0.1 s'
haptic-rt --profile /usr/share/tensormass/profiles/impulse_engine.profile --params | grep force_max_N
tm-device --version
tm-view --version
man -w tm-sim 2>/dev/null || test -f /usr/share/man/man1/tm-sim.1.gz
# A program against the library.
cc /usr/share/doc/tensormass/examples/block.c $(pkg-config --cflags --libs tensormass) -o block && ./block
cc /usr/share/doc/tensormass/examples/engine.c $(pkg-config --cflags --libs tensormass_io) -lpthread -lm -o engine && ./engine /usr/share/tensormass/meshes/liver_1k.msh 2
printf '#include <tensormass_solve.h>\nint main(void) { return tm_precomputed_def_default().cookie == 0; }\n' > solve.c
cc solve.c $(pkg-config --cflags --libs tensormass_solve) -o solve && ./solve
cc /usr/share/doc/tensormass/examples/press.c $(pkg-config --cflags --libs tensormass_scene) -o press && ./press /tmp/mine/apps/scenes/block-press.yaml haptics
# Python.
python3 -c "
import tensormass as tm
mesh = tm.Mesh.block((0.06, 0.06, 0.03), (4, 4, 2))
world = tm.World(tm.Tissue(mesh, tm.Material.young(5e3, 0.45, density_kg_m3=1060, damping_1_s=40)))
world.add_support(mesh.near((0, 0, 0), (0, 0, 1)))
world.add_gravity((0, 0, -9.81))
world.step(100)
assert world.u_m.min() < 0
scene = tm.Scene('/tmp/mine/apps/scenes/block-gravity.yaml')
scene.step()
assert tm.parameters().force_max_N > 8
"
# The unit, its user and the rule.
getent passwd haptic-rt
grep -q haptic-rt /lib/udev/rules.d/60-haptic-rt.rules
grep -q 'ExecStart=/usr/bin/haptic-rt ' /lib/systemd/system/haptic-rt@.service
test ! -e /etc/systemd/system/multi-user.target.wants/haptic-rt@0.service
# Away again.
rm -rf /root/.cache/tensormass /tmp/mine /tmp/block /tmp/engine /tmp/press /tmp/solve /tmp/solve.c
apt-get purge -y -q libtensormass0.1 libtensormass-solve0.1 libtensormass-scene0.1 libtensormass-dev tensormass-tools haptic-rt python3-tensormass
dpkg -l '*tensormass*' 'haptic-rt*' 2>/dev/null | grep '^[ir]' && exit 1
find / -xdev ! -path '/proc/*' ! -path '/sys/*' ! -path '/tmp/*' \( -name '*tensormass*' -o -name '*haptic*' \) ! -path '/var/cache/apt/*' ! -path '/var/lib/apt/*' > /tmp/left
cat /tmp/left && test ! -s /tmp/left
echo used and purged
"""


@pytest.fixture(scope="module")
def packages(root, make_once):
    make_once("deb")
    return root / "build/deb"


def test_packages_and_their_names(packages, root):
    number = re.search(r"^VERSION := (\d+\.\d+)", (root / "Makefile").read_text(), re.M)[1]
    names = {p.name.split("_")[0] for p in packages.glob("*.deb")}
    assert names == {f"libtensormass{number}", f"libtensormass-solve{number}", f"libtensormass-scene{number}", "libtensormass-dev", "tensormass-tools", "haptic-rt", "python3-tensormass"}

    def depends(name):
        package, = packages.glob(f"{name}_*.deb")
        return subprocess.run(["dpkg-deb", "-f", package, "Depends"], capture_output=True, text=True, check=True).stdout
    assert set(re.findall(r"[\w.+-]+(?= \()|[\w.+-]+$", depends(f"libtensormass{number}"))) <= {"libc6"}
    assert "libcholmod" in depends(f"libtensormass-solve{number}") and "libcholmod" not in depends("haptic-rt")
    assert not re.search("libsdl|libosmesa|libcholmod", depends("haptic-rt").lower())


def test_lintian_finds_no_error(packages):
    changes, = packages.glob("*.changes")
    run = subprocess.run(["lintian", "--allow-root", "--fail-on", "error", changes], capture_output=True, text=True, timeout=900)
    assert run.returncode == 0 and not re.search(r"^E:", run.stdout, re.M), run.stdout + run.stderr


def test_installed_used_and_purged_in_a_system_of_its_own(packages, tmp_path):
    if not shutil.which("mmdebstrap") or os.geteuid():
        pytest.skip("needs mmdebstrap and root")
    (tmp_path / "used.sh").write_text(USED)
    debs = tmp_path / "debs"
    debs.mkdir()
    for package in packages.glob("*.deb"):
        shutil.copy(package, debs)
    os.chmod(tmp_path, 0o755)
    run = subprocess.run(["mmdebstrap", "--variant=apt", "--mode=root", f"--customize-hook=copy-in {debs} {tmp_path}/used.sh /tmp", "--customize-hook=chroot \"$1\" sh /tmp/used.sh",
                          "bookworm", "/dev/null", *sorted(str(p) for p in pathlib.Path("/etc/apt").rglob("*.sources"))], capture_output=True, text=True, timeout=3000)
    assert run.returncode == 0 and "used and purged" in run.stdout + run.stderr, run.stdout[-3000:] + run.stderr[-3000:]
