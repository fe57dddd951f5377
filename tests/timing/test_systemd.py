"""The service of a dedicated machine: systemd understands it, and its command line is one that haptic-rt takes."""
import re
import shlex
import subprocess

from paths import BUILD, ROOT

UNIT = ROOT / "haptic_rt" / "systemd" / "haptic-rt@.service.in"


def test_systemd_understands_it(tmp_path):
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/haptic-rt").symlink_to(BUILD / "bin/haptic-rt")
    unit = tmp_path / "haptic-rt@0.service"
    unit.write_text(UNIT.read_text().replace("@PREFIX@", str(tmp_path)))
    done = subprocess.run(["systemd-analyze", "verify", "--recursive-errors=no", "--man=no", unit], capture_output=True, text=True, timeout=60)
    complaints = [line for line in (done.stdout + done.stderr).splitlines() if "haptic-rt" in line]
    assert done.returncode == 0 and not complaints, done.stderr
    broken = tmp_path / "haptic-rt@1.service"
    broken.write_text(unit.read_text().replace("Restart=no", "Restart=sometimes"))
    done = subprocess.run(["systemd-analyze", "verify", "--recursive-errors=no", "--man=no", broken], capture_output=True, text=True, timeout=60)
    assert "sometimes" in done.stderr, "the check does not check"


def test_its_command_line_is_taken(tmp_path):
    settings = dict(line.split("=", 1) for line in (ROOT / "haptic_rt/systemd/haptic-rt-0.conf").read_text().splitlines() if "=" in line and line[0] != "#")
    command = re.search(r"^ExecStart=(.*)$", UNIT.read_text(), re.M)[1].replace("@PREFIX@", str(BUILD)).replace("%i", "0")
    (tmp_path / "haptic.key").write_text("0123456789abcdef0123456789abcdef\n")
    (tmp_path / "haptic.key").chmod(0o600)
    command = command.replace("%d", str(tmp_path)).replace("${HAPTIC_RT_BUS}", "virtual:unit").replace("$HAPTIC_RT_ARGS", settings["HAPTIC_RT_ARGS"])
    (tmp_path / "none.csv").write_text("time_s,fx_N,fy_N,fz_N\n0,0,0,0\n")
    argv = shlex.split(command) + ["--samples", str(tmp_path / "none.csv"), "--duration", "0.2"]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=20, env={"TM_BUS_DIR": str(tmp_path)})
    assert done.returncode == 0, done.stderr
