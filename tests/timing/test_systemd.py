"""The service of a dedicated machine: systemd accepts it, and haptic-rt accepts its command line."""
import os
import re
import shlex
import subprocess

from paths import BUILD, ROOT

UNIT = ROOT / "haptic_rt" / "systemd" / "haptic-rt@.service.in"


def test_systemd_accepts_the_service(tmp_path):
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/haptic-rt").symlink_to(BUILD / "bin/haptic-rt")
    unit = tmp_path / "haptic-rt@0.service"
    unit.write_text(UNIT.read_text().replace("@PREFIX@", str(tmp_path)))
    done = subprocess.run(["systemd-analyze", "verify", "--recursive-errors=no", "--man=no", unit], capture_output=True, text=True, timeout=300)
    complaints = [line for line in (done.stdout + done.stderr).splitlines() if "haptic-rt" in line]
    assert done.returncode == 0 and not complaints, done.stderr
    broken = tmp_path / "haptic-rt@1.service"
    broken.write_text(unit.read_text().replace("Restart=no", "Restart=sometimes"))
    done = subprocess.run(["systemd-analyze", "verify", "--recursive-errors=no", "--man=no", broken], capture_output=True, text=True, timeout=300)
    assert "sometimes" in done.stderr, "the check does not check"


def test_haptic_rt_accepts_the_services_command_line(tmp_path):
    settings = dict(line.split("=", 1) for line in (ROOT / "haptic_rt/systemd/haptic-rt-0.conf").read_text().splitlines() if "=" in line and line[0] != "#")
    command = re.search(r"^ExecStart=(.*)$", UNIT.read_text(), re.M)[1].replace("@PREFIX@", str(BUILD)).replace("%i", "0")
    (tmp_path / "haptic.key").write_text("0123456789abcdef0123456789abcdef\n")
    (tmp_path / "haptic.key").chmod(0o600)
    command = command.replace("%d", str(tmp_path)).replace("${HAPTIC_RT_BUS}", "virtual:unit").replace("$HAPTIC_RT_ARGS", settings["HAPTIC_RT_ARGS"])
    (tmp_path / "none.csv").write_text("time_s,fx_N,fy_N,fz_N\n0,0,0,0\n")
    argv = shlex.split(command) + ["--samples", str(tmp_path / "none.csv"), "--duration", "0.2"]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=120, env={"TM_BUS_DIR": str(tmp_path)})
    assert done.returncode == 0, done.stderr


def test_the_pages_commands_put_settings_where_the_service_looks(tmp_path):
    """docs/dedicated-machine.md, The service, as written, except for the machine's own /etc, /usr/local and systemctl."""
    page = (ROOT / "docs/dedicated-machine.md").read_text()
    lines = re.findall(r"^    (.*)$", page[page.index("## The service"):page.index("## Timing figures")], re.M)
    assert sum("systemctl" in line for line in lines) == 2
    commands = "\n".join(line for line in lines if not re.match(r"systemctl|journalctl", line))
    done = subprocess.run(["make", "--no-print-directory", "install-controller", f"PREFIX={tmp_path}/usr/local"], cwd=ROOT, capture_output=True, text=True, timeout=600,
                          env={k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")})
    assert done.returncode == 0, done.stderr
    done = subprocess.run(["bash", "-ec", commands.replace("/usr/local", f"{tmp_path}/usr/local").replace("/etc/", f"{tmp_path}/etc/")], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    unit = (tmp_path / "usr/local/lib/systemd/system/haptic-rt@.service").read_text()
    for named in (re.search(r"^EnvironmentFile=-(.*)$", unit, re.M)[1].replace("%i", "0"), re.search(r"^LoadCredential=haptic.key:(.*)$", unit, re.M)[1]):
        assert (tmp_path / named.lstrip("/")).is_file(), named
    key = tmp_path / "etc/tensormass/haptic.key"
    assert re.fullmatch(r"[0-9a-f]{32}\n", key.read_text()) and key.stat().st_mode & 0o077 == 0
    # Any processor if none was selected: a machine may have fewer than four.
    assert "CPUAffinity" not in unit
    assert "CPUAffinity=3" in (tmp_path / "etc/systemd/system/haptic-rt@.service.d/processor.conf").read_text()
