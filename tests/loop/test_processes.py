"""haptic-rt and tm-device as separate processes on a virtual bus, and the failure of either."""
import csv
import json
import math
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import time

import pytest
from virtual_bus import VirtualBus, Watch, torque

COMMAND, DEVICE_FAULT = 0x100, 0x080
FORCE_N = 2.0


@pytest.fixture
def ring(bin, tmp_path):
    """Starts programs and ends them in any case."""
    class Ring:
        def __init__(self):
            # The bus is in memory by default: on a disk, the pages of its file are write-protected whenever they are written back.
            self.bus_directory = tempfile.mkdtemp(prefix="tm-test-", dir="/dev/shm")
            self.running, self.env = [], dict(os.environ, TM_BUS_DIR=self.bus_directory)
            self.directory = tmp_path

        def start(self, *argv):
            log = tempfile_at(tmp_path, argv[0], len(self.running))
            process = subprocess.Popen([bin / argv[0], *map(str, argv[1:])], env=self.env, stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)
            process.log = log
            self.running.append(process)
            return process

        def device(self, *more):
            return self.start("tm-device", "--bus", "virtual:t", "--duration", 30, *more)

        def controller(self, *more):
            return self.start("haptic-rt", "--bus", "virtual:t", "--trocar", "0,0,0", "--duration", 30, *more)

        def samples(self, seconds=30, rate=30):
            path = tmp_path / "samples.csv"
            with open(path, "w") as file:
                file.write("# constant pull along the shaft\ntime_s,fx_N,fy_N,fz_N\n")
                for i in range(int(seconds * rate)):
                    file.write(f"{i / rate:.5f},0,0,{-FORCE_N}\n")
            return path

        def hand(self):
            path = tmp_path / "hand.csv"
            path.write_text("time_s,pitch_rad,yaw_rad,insertion_m,roll_rad,grip\n0,0,0,0.10,0,0\n1,0.1,-0.1,0.13,0.5,1\n2,0,0,0.10,0,0\n")
            return path
    r = Ring()
    yield r
    for process in r.running:
        process.kill()
        process.wait()
    shutil.rmtree(r.bus_directory)


def tempfile_at(directory, name, number):
    return open(directory / f"{name}_{number}.log", "w+")


def text(process):
    process.log.flush()
    with open(process.log.name) as file:
        return file.read()


def until(condition, what, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"{what}: not within {seconds} s"
        time.sleep(0.005)


def pushing(watch, since=0.0):
    moment, data = watch.last(COMMAND)
    return data is not None and moment > since and time.monotonic() - moment < 0.1 and abs(torque(data)[2]) > 900 * FORCE_N


def end(process, code=0):
    process.send_signal(signal.SIGTERM)
    assert process.wait(10) == code, text(process)


@pytest.mark.parametrize("device_first", [True, False])
def test_programs_start_in_any_order_and_report_what_they_wait_for(ring, device_first):
    first = ring.device("--hand", ring.hand(), "--repeat") if device_first else ring.controller("--samples", ring.samples())
    until(lambda: "waiting for" in text(first), "the first says what it waits for")
    second = ring.controller("--samples", ring.samples()) if device_first else ring.device("--hand", ring.hand(), "--repeat")
    watch = Watch(VirtualBus(ring.bus_directory, "t"))
    until(lambda: pushing(watch), "force on the bus")
    controller = second if device_first else first
    assert "engaged" in text(controller)
    end(controller)
    until(lambda: watch.last(COMMAND)[1][6] & 0x80 == 0, "motors off at the end")


def test_report_has_the_expected_figures(ring):
    device = ring.start("tm-device", "--bus", "virtual:t", "--hand", ring.hand(), "--repeat", "--duration", 4, "--json", ring.directory / "d.json", "--stats")
    controller = ring.controller("--samples", ring.samples(), "--duration", 3, "--stats", "--json", ring.directory / "c.json", "--record", ring.directory / "r.csv",
                                 "--extrapolator", "hold", "--no-passivity")  # recorded forces do not react to the hand: they are not passive
    assert controller.wait(20) == 0 and device.wait(20) == 0
    c, d = (json.loads((ring.directory / f"{n}.json").read_text()) for n in "cd")
    rows = list(csv.DictReader(open(ring.directory / "r.csv")))
    assert c["ticks"] + c["missed_ticks"] >= 1450 and len(rows) == c["ticks"]
    assert c["state"] == "engaged" and c["fault"] == "none" and c["extrapolator"] == "hold" and c["passivity"] is False
    assert abs(c["force_N"]["peak"] - FORCE_N) < 0.01 and 0.5 * FORCE_N < c["force_N"]["rms"] <= FORCE_N
    for stage in ("receive", "control", "send", "publish"):
        q = c["stage_us"][stage]
        assert 0 < q["p50"] <= q["p99"] <= q["p999"] <= q["max"]
    assert c["samples"]["rejected"] == 0 and 60 <= c["samples"]["received"] <= 95
    # A lost command is a gap in the counter, never lateness: none over shared memory.
    assert d["can"]["lost"] == 0 and c["can"]["lost"] == 0 and c["can"]["corrupt"] == 0 and c["can"]["foreign"] == 0
    assert abs(d["commands"] - c["ticks"]) <= 2
    assert 15 < c["can"]["load_percent"] < 25
    # Held by the hand's spring, the device is pushed towards the trocar, and the torque follows the Jacobian.
    last = rows[-1]
    assert abs(float(last["fz_N"]) + FORCE_N) < 0.01 and float(last["gain"]) == 1.0
    pitch, yaw = float(last["pitch_rad"]), float(last["yaw_rad"])
    assert abs(float(last["force_insertion_N"]) + FORCE_N * math.cos(pitch) * math.cos(yaw)) < 0.01
    assert d["torque_peak"][2] == pytest.approx(FORCE_N, abs=0.02)
    assert "ticks" in text(controller) and "lateness" in text(controller)


@pytest.mark.parametrize("option, on", [([], True), (["--passivity"], True), (["--no-passivity"], False)])
def test_passivity_is_on_unless_told_otherwise(bin, tmp_path, option, on):
    """As in lockstep (`haptics.passivity`) and in the shipped settings."""
    run = subprocess.run([bin / "haptic-rt", "--bus", "virtual:p", "--duration", "0.05", "--priority", "0", *option, "--json", tmp_path / "c.json"],
                         env={**os.environ, "TM_BUS_DIR": str(tmp_path)}, capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run
    assert json.loads((tmp_path / "c.json").read_text())["passivity"] is on


def test_no_page_fault_after_start(ring):
    """The kernel may move pages and cause a fault now and then; faults of the program itself would occur in every run."""
    ring.device()
    seen = []
    for attempt in range(4):
        controller = ring.controller("--samples", ring.samples(), "--duration", 2.5, "--json", ring.directory / "c.json")
        assert controller.wait(20) == 0
        c = json.loads((ring.directory / "c.json").read_text())
        assert c["page_faults_major"] == 0
        seen.append(c["page_faults_minor"])
        if seen[-1] == 0 or not c["real_time"]:
            return
    raise AssertionError(f"page faults of the loop's thread after its first second, in four runs: {seen}")


def syscalls(path):
    """Returns the calls by name of each thread of a `strace -f` log."""
    calls = {}
    for line in open(path, errors="replace"):
        parts = line.split(None, 1)
        name = parts[1].split("(")[0].strip() if len(parts) == 2 and "(" in parts[1] else ""
        if parts and parts[0].isdigit() and name.isidentifier():
            calls.setdefault(int(parts[0]), []).append(name)
    return calls


def test_system_calls_of_the_loop_are_the_listed_ones(bin, ring):
    """docs/controller.md, "In the loop": with a virtual bus and recorded samples the loop's thread only sleeps."""
    ring.device()
    trace = ring.directory / "trace"
    run = subprocess.Popen(["strace", "-f", "-o", trace, bin / "haptic-rt", "--bus", "virtual:t", "--trocar", "0,0,0", "--samples", ring.samples(),
                            "--duration", "3"], env=ring.env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    ring.running.append(run)
    assert run.wait(60) == 0
    loop = max(syscalls(trace).values(), key=lambda calls: calls.count("clock_nanosleep") if len(set(calls)) < 15 else 0)
    first, last = loop.index("clock_nanosleep"), len(loop) - 1 - loop[::-1].index("clock_nanosleep")
    assert loop.count("clock_nanosleep") > 1000
    # getrusage once after the first second: from there page faults are counted
    assert set(loop[first:last]) <= {"clock_nanosleep", "getrusage"}, set(loop[first:last])


def test_controller_killed_drops_the_torque_and_a_new_one_takes_over(ring):
    device = ring.device("--hand", ring.hand())
    controller = ring.controller("--samples", ring.samples())
    bus = VirtualBus(ring.bus_directory, "t")
    watch = Watch(bus)
    until(lambda: pushing(watch), "force")
    controller.kill()
    until(lambda: watch.last(DEVICE_FAULT)[0] is not None, "the device tells of its watchdog", 2)
    last_command = watch.last(COMMAND)[0]
    dropped = next(t for t, i, d in watch.frames if i == DEVICE_FAULT)
    # 20 ms by its own clock (tests/loop/test_ring.c, on a virtual one); here the scheduler delays this process and the device.
    assert dropped - last_command < 0.150
    until(lambda: "commands stopped" in text(device), "it says so")
    again, since = ring.controller("--samples", ring.samples()), time.monotonic()
    until(lambda: pushing(watch, since), "force again")
    assert "well again" in text(device)
    end(again)


def test_device_killed_and_restarted(ring):
    device = ring.device("--hand", ring.hand())
    controller = ring.controller("--samples", ring.samples(), "--auto-reset", 0.3)
    watch = Watch(VirtualBus(ring.bus_directory, "t"))
    until(lambda: pushing(watch), "force")
    device.kill()
    killed = time.monotonic()
    until(lambda: watch.last(COMMAND)[1][6] & 0x80 == 0, "motors off", 2)
    first_off = next(t for t, i, d in watch.frames if i == COMMAND and t >= killed and not d[6] & 0x80)
    assert first_off - killed < 0.150 and torque(watch.last(COMMAND)[1]) == (0, 0, 0)
    until(lambda: "waiting for device 0" in text(controller), "it waits for the device")
    ring.device()
    since = time.monotonic()
    until(lambda: pushing(watch, since), "force again")
    end(controller)


def test_bus_off_and_recovery(ring):
    ring.device()
    controller = ring.controller("--samples", ring.samples(), "--auto-reset", 0.5)
    bus = VirtualBus(ring.bus_directory, "t")
    watch = Watch(bus)
    until(lambda: pushing(watch), "force")
    bus.set_off(True)
    until(lambda: "fault bus_off" in text(controller), "the fault is told")
    bus.set_off(False)
    since = time.monotonic()
    until(lambda: pushing(watch, since), "force again")
    assert "reset by --auto-reset" in text(controller)
    end(controller)


def test_foreign_and_corrupt_frames_change_nothing(ring):
    ring.device()
    controller = ring.controller("--samples", ring.samples(), "--duration", 4, "--json", ring.directory / "c.json")
    bus = VirtualBus(ring.bus_directory, "t")
    watch = Watch(VirtualBus(ring.bus_directory, "t"))
    until(lambda: pushing(watch), "force")
    for k in range(50):
        bus.send(0x123, b"\x01\x02")
        bus.send(0x110, bytes(8))      # an EncoderA with a wrong checksum
        time.sleep(0.002)
    assert pushing(watch)
    assert controller.wait(20) == 0
    c = json.loads((ring.directory / "c.json").read_text())
    assert c["can"]["foreign"] >= 40 and c["can"]["corrupt"] >= 40 and c["fault"] == "none"


def refused(ring, program, *argv):
    run = subprocess.run([program, "--bus", "virtual:t", "--duration", "1", *argv], env=ring.env, capture_output=True, text=True, timeout=120)
    return run.returncode == 2 and " is already " in run.stderr and "; end it" in run.stderr


def test_a_second_controller_or_device_is_refused_and_disturbs_nobody(bin, ring):
    """Two controllers on one device would push alternately, a thousand times a second."""
    device = ring.device()
    controller = ring.controller("--samples", ring.samples(), "--json", ring.directory / "c.json")
    watch = Watch(VirtualBus(ring.bus_directory, "t"))
    until(lambda: pushing(watch), "force")
    for _ in range(5):
        assert refused(ring, bin / "haptic-rt", "--trocar", "0,0,0") and refused(ring, bin / "tm-device")
    assert pushing(watch) and "fault" not in text(controller) and "commands stopped" not in text(device)
    # The other instrument is free; and an instrument is free again however its holder ended, stopped ones excepted.
    other = ring.controller("--instrument", 1)
    until(lambda: "waiting for device 1" in text(other), "the other instrument")
    controller.send_signal(signal.SIGSTOP)
    assert refused(ring, bin / "haptic-rt", "--trocar", "0,0,0")
    controller.kill()
    controller.wait()
    ring.controller("--samples", ring.samples())
    since = time.monotonic()
    until(lambda: pushing(watch, since), "force of the next one")


def test_bus_conflict_is_a_fault_with_its_reason(ring):
    """A controller on another machine, where no lock applies: one forged frame under the controller's own id."""
    ring.device()
    controller = ring.controller("--samples", ring.samples(), "--auto-reset", 1.5)
    bus = VirtualBus(ring.bus_directory, "t")
    watch = Watch(VirtualBus(ring.bus_directory, "t"))
    until(lambda: pushing(watch), "force")
    frame = watch.last(COMMAND)[1]
    bus.send(COMMAND, frame)
    until(lambda: "fault bus_conflict (0): Another controller commands this device" in text(controller), "the fault is told", 2)
    until(lambda: "still in fault bus_conflict" in text(controller), "and told again", 2)
    since = time.monotonic()
    until(lambda: pushing(watch, since), "force after the reset")


@pytest.mark.parametrize("harm", ["truncate", "shorten", "unlink", "replace", "remove the folder"])
def test_lost_bus_file_is_noticed_and_repaired(ring, harm):
    device = ring.device()
    controller = ring.controller("--samples", ring.samples(), "--auto-reset", 0.5)
    watch = Watch(VirtualBus(ring.bus_directory, "t"))
    until(lambda: pushing(watch), "force")
    watch.stop = True  # before its own mapping becomes invalid
    watch.join()
    path = os.path.join(ring.bus_directory, "t.bus")
    if harm in ("truncate", "shorten"):
        os.truncate(path, 0 if harm == "truncate" else 5000)
    elif harm == "unlink":
        os.unlink(path)
    elif harm == "remove the folder":
        shutil.rmtree(ring.bus_directory)
    else:
        with open(path + ".new", "wb") as file:
            file.truncate(64 + 4096 * 88)
        os.rename(path + ".new", path)
    what = "its file was truncated" if harm in ("truncate", "shorten") else "its file was removed or replaced"
    # The first of the two repairs it: the other one may find it repaired, or notice first.
    until(lambda: what in text(controller) + text(device), "it is told", 2)
    watch, since = Watch(VirtualBus(ring.bus_directory, "t")), time.monotonic()
    until(lambda: pushing(watch, since), "force on the repaired bus")
    until(lambda: "its file exists again" in text(controller) + text(device), "that is told too", 2)
    assert device.poll() is None and controller.poll() is None
    until(lambda: refused(ring, controller.args[0], "--trocar", "0,0,0"), "the place is held on the repaired bus", 3)


def test_the_bus_folder_is_the_real_users_and_goes_with_the_last(bin, ring):
    """In a user namespace every user is root: the name is made of the user id outside."""
    env = {k: v for k, v in os.environ.items() if k != "TM_BUS_DIR"}
    plain, name = pathlib.Path(f"/dev/shm/tensormass-{os.getuid()}"), f"t{os.getpid()}"
    bus = f"virtual:{name}"
    before = plain.exists()
    inside = "1000" if os.getuid() == 0 else "0"
    run = ["unshare", "-U", f"--map-user={inside}", bin / "tm-device", "--bus", bus, "--duration", "1"]
    for _ in range(2):  # each of the two is the last one once
        first = subprocess.Popen(run, env=env, stderr=subprocess.PIPE, text=True)
        until(lambda: (plain / f"{name}.bus").exists() or first.poll(), "the bus in the folder of who one is outside")
        second = subprocess.run([bin / "haptic-rt", "--bus", bus, "--duration", "0.4" if _ else "1.5"], env=env, capture_output=True, text=True, timeout=120)
        said = first.communicate(timeout=120)[1]
        assert first.returncode == 0 and second.returncode == 0 and "receiving commands" in said, said + second.stderr
        assert not (plain / f"{name}.bus").exists()
    assert before or not plain.exists()


def test_the_log_has_times_and_comes_in_pairs(ring):
    """A simulation that stops for half a second of every second."""
    samples = ring.directory / "holes.csv"
    samples.write_text("time_s,fx_N,fy_N,fz_N\n" + "".join(f"{i / 50:.3f},0,0,-1\n" for i in range(50 * 5) if i % 50 < 25))
    ring.device()
    controller = ring.controller("--samples", samples, "--duration", 5)
    assert controller.wait(30) == 0
    lines = [line for line in text(controller).splitlines() if not line.startswith("haptic-rt: ")]
    assert all(re.fullmatch(r"haptic-rt \d+\.\d{3} s: .+", line) for line in lines), lines
    times = [float(line.split()[1]) for line in lines]
    assert times == sorted(times) and times[-1] < 5.5
    pairs = [line.split(": ")[1] for line in lines if "no samples from the simulation" in line or "from the simulation again" in line]
    assert len(pairs) >= 6, lines
    assert all(("no samples from the simulation" in a) != ("no samples from the simulation" in b) for a, b in zip(pairs, pairs[1:])), lines


def test_a_long_record_takes_no_more_memory_than_a_short_one(bin, ring):
    ring.device()
    path = ring.directory / "r.csv"
    controller = ring.controller("--samples", ring.samples(), "--duration", 60000, "--record", path)
    until(lambda: "engaged" in text(controller), "engaged")
    time.sleep(1)
    status = dict(line.split(":", 1) for line in open(f"/proc/{controller.pid}/status"))
    assert int(status["VmRSS"].split()[0]) < 100e3, status["VmRSS"]
    end(controller)
    rows = list(csv.DictReader(open(path)))
    assert len(rows) > 300 and len(rows[-1]) == 17 and None not in rows[-1].values()
    times = [float(row["time_s"]) for row in rows]
    assert times == sorted(set(times))


def test_two_devices_on_one_bus_feel_their_own_forces(ring):
    for i in range(2):
        ring.start("tm-device", "--bus", "virtual:t", "--instrument", i, "--duration", 4.5, "--json", ring.directory / f"d{i}.json")
        samples = ring.directory / f"s{i}.csv"
        samples.write_text("time_s,fx_N,fy_N,fz_N\n" + "".join(f"{k / 30:.4f},0,0,{-1.0 - i}\n" for k in range(200)))
        ring.controller("--instrument", i, "--samples", samples, "--duration", 4, "--json", ring.directory / f"c{i}.json")
    for process in ring.running:
        assert process.wait(20) == 0, text(process)
    for i in range(2):
        d, c = (json.loads((ring.directory / f"{n}{i}.json").read_text()) for n in "dc")
        assert d["torque_peak"][2] == pytest.approx(1.0 + i, abs=0.02)
        assert c["fault"] == "none" and c["can"]["load_percent"] < 60 and d["can"]["lost"] == 0
        if c["missed_ticks"] == 0:
            assert c["can"]["load_percent"] > 30


BAD = [
    ("haptic-rt", [], "--bus"),
    ("haptic-rt", ["--bus", "nonsense"], "virtual:NAME or socketcan:INTERFACE"),
    ("haptic-rt", ["--bus", "virtual:a/b"], "name of a virtual bus needs"),
    ("haptic-rt", ["--bus", "socketcan:no_such_interface"], "socketcan"),
    ("haptic-rt", ["--bus", "virtual:t", "--extrapolator", "psychic"], "hold time position"),
    ("haptic-rt", ["--bus", "virtual:t", "--rate", "5"], "from 100 to 4000"),
    ("haptic-rt", ["--bus", "virtual:t", "--instrument", "2"], "from 0 to 1"),
    ("haptic-rt", ["--bus", "virtual:t", "--trocar", "1,2"], "X,Y,Z"),
    ("haptic-rt", ["--bus", "virtual:t", "--axis", "0,1,0"], "--axis"),
    ("haptic-rt", ["--bus", "virtual:t", "--samples", "missing.csv"], "missing.csv: cannot be read"),
    ("haptic-rt", ["--bus", "virtual:t", "--profile", "missing.profile"], "cannot be read"),
    ("haptic-rt", ["--bus", "virtual:t", "--set", "force_max_N=99"], "from 0 to 20"),
    ("haptic-rt", ["--bus", "virtual:t", "--set", "farce=1"], "not a parameter"),
    ("haptic-rt", ["--bus", "virtual:t", "--set", "force_max_N=3" + " " * 1020 + "9"], "longer than any parameter"),
    ("haptic-rt", ["--bus", "virtual:t", "--wat"], "unknown option"),
    ("haptic-rt", ["--bus", "virtual:t", "surplus"], "not an option"),
    ("haptic-rt", ["--bus"], "needs a value"),
    ("tm-device", [], "--bus"),
    ("tm-device", ["--bus", "virtual:t", "--hand", "missing.csv"], "cannot be read"),
    ("tm-device", ["--bus", "virtual:t", "--tremor", "1"], "from 0 to 0.01"),
    ("tm-device", ["--bus", "virtual:t", "--wat"], "unknown option"),
]


@pytest.mark.parametrize("program,argv,expected", BAD, ids=lambda v: " ".join(v) if isinstance(v, list) else None)
def test_invalid_options_are_rejected(bin, tmp_path, program, argv, expected):
    if any("socketcan:" in a for a in argv):
        expected = "cannot open no_such_interface" if len("no_such_interface") < 16 else "not an interface name"
    run = subprocess.run([bin / program, *argv], cwd=tmp_path, env=dict(os.environ, TM_BUS_DIR=str(tmp_path)), capture_output=True, text=True, timeout=120)
    assert run.returncode == 2 and expected in run.stderr and "; " in run.stderr, run.stderr
    assert [p for p in tmp_path.iterdir() if p.suffix != ".bus"] == []


@pytest.mark.parametrize("name,content,line,expected", [
    ("s.csv", "time_s,fx_N,fy_N\n0,0,0\n", 1, "no column 'fz_N'"),
    ("s.csv", "time_s,fx_N,fy_N,fz_N\n0,0,0,1\n0.1,0,x,1\n", 3, "not a finite number"),
    ("s.csv", "time_s,fx_N,fy_N,fz_N\n0,0,0\n", 2, "3 values where the header has 4"),
    ("s.csv", "time_s,fx_N,fy_N,fz_N\n", 0, "holds no rows"),
    ("s.csv", "time_s,fx_N,fy_N,fz_N\n0,0,0,nan\n", 2, "not a finite number"),
    ("h.csv", "time_s,pitch_rad,yaw_rad,insertion_m,roll_rad,grip\n0,0,0,0.1,0,0\n0,0,0,0.1,0,0\n", 3, "ascending"),
    ("p.profile", "force_max_N = 8\nfarce = 3\n", 2, "not a parameter"),
    ("p.profile", "# fine\n\njoint_min = 0 0\n", 3, "give 5"),
    ("p.profile", "force_max_N 8\n", 1, "no '='"),
    ("p.profile", "joint_min = 1 1 1 1 1\n", 0, "lower end"),
])
def test_invalid_files_are_rejected(bin, tmp_path, name, content, line, expected):
    path = tmp_path / name
    path.write_text(content)
    option = {"s.csv": "--samples", "h.csv": "--hand", "p.profile": "--profile"}[name]
    program = "tm-device" if option == "--hand" else "haptic-rt"
    run = subprocess.run([bin / program, "--bus", "virtual:t", option, path], env=dict(os.environ, TM_BUS_DIR=str(tmp_path)), capture_output=True, text=True, timeout=120)
    where = f"{path}:{line}: " if line else f"{path}: "
    assert run.returncode == 2 and run.stderr.startswith(where) and expected in run.stderr, run.stderr


@pytest.mark.parametrize("length", [400, 511, 512, 1000, 2048, 60000])
def test_a_long_comment_never_becomes_a_setting(bin, tmp_path, length):
    """A line that is split at any length would be read as a comment and a setting."""
    (tmp_path / "p.profile").write_text("force_max_N = 3 #" + "x" * (length - 17) + "force_max_N = 20\n")
    run = subprocess.run([bin / "haptic-rt", "--profile", tmp_path / "p.profile", "--params"], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0 and "force_max_N = 3\n" in run.stdout, run.stderr
    samples = tmp_path / "s.csv"
    samples.write_text("time_s,fx_N,fy_N,fz_N #" + "x" * (length - 23) + "0,0,0\n0,0,0,1\n")
    run = subprocess.run([bin / "haptic-rt", "--bus", "virtual:t", "--samples", samples, "--duration", "0.02", "--priority", "0"],
                         env=dict(os.environ, TM_BUS_DIR=str(tmp_path)), capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("content", ["#" + "x" * 70000 + "\nforce_max_N = 20\n", "force_max_N = 3\0\nforce_max_N = 20\n"])
def test_a_line_that_cannot_be_read_whole_is_refused(bin, tmp_path, content):
    path = tmp_path / "p.profile"
    path.write_text(content)
    run = subprocess.run([bin / "haptic-rt", "--profile", path, "--params"], capture_output=True, text=True, timeout=120)
    assert run.returncode == 2 and run.stderr.startswith(f"{path}:1: longer than 65534 characters") and run.stdout == ""


@pytest.mark.parametrize("program", ["haptic-rt", "tm-device"])
def test_help_and_version(bin, program):
    for option, expected in (("--help", "usage: " + program), ("--version", program + " ")):
        run = subprocess.run([bin / program, option], capture_output=True, text=True, timeout=120)
        assert run.returncode == 0 and run.stdout.startswith(expected) and run.stderr == ""


def test_an_unwritable_report_is_told_at_once(bin, tmp_path):
    run = subprocess.run([bin / "tm-device", "--bus", "virtual:t", "--json", tmp_path / "no" / "such.json"], env=dict(os.environ, TM_BUS_DIR=str(tmp_path)),
                         capture_output=True, text=True, timeout=120)
    assert run.returncode == 2 and "such.json" in run.stderr


def test_a_profile_of_another_device_is_refused_by_its_name(bin, tmp_path):
    """Even if all its counts would fit; with the right --device-type it is accepted."""
    run = lambda *words: subprocess.run([bin / "haptic-rt", *words, "--params"], capture_output=True, text=True, timeout=120)
    path = tmp_path / "desk.profile"
    lines = run("--device-type", "desk").stdout.splitlines(True)
    path.write_text("".join(line for line in lines if line.startswith(("device", "force_max_N", "torque_max"))))
    refused = run("--profile", path)
    assert refused.returncode == 2 and refused.stdout == ""
    assert refused.stderr.startswith(f"{path}:1: the profile is of device 'desk', and this device is 'impulse_engine'; add --device-type desk, or"), refused.stderr
    assert run("--device-type", "desk", "--profile", path).stdout == "".join(lines)


def test_the_shipped_profile_is_the_default(bin, root, tmp_path):
    plain, profiled = (subprocess.run([bin / "haptic-rt", *more, "--params"], capture_output=True, text=True, timeout=120).stdout
                       for more in ([], ["--profile", root / "haptic_rt/device/profiles/impulse_engine.profile"]))
    assert plain == profiled and "force_max_N = 8.9" in plain
    path = tmp_path / "own.profile"
    path.write_text(plain)
    assert subprocess.run([bin / "haptic-rt", "--profile", path, "--params"], capture_output=True, text=True, timeout=120).stdout == plain


def test_bus_recovers_from_overwritten_contents(ring):
    """Another process writes over the file: it is a bus again within 100 ms. After a reset, if the controller had noticed, force returns."""
    ring.device("--hand", ring.hand(), "--repeat")
    controller = ring.controller("--samples", ring.samples(), "--auto-reset", 1)
    file = pathlib.Path(ring.bus_directory) / "t.bus"
    watch = Watch(VirtualBus(ring.bus_directory, "t"))
    until(lambda: pushing(watch), "force on the bus")
    with open(file, "r+b") as bus:
        bus.write(os.urandom(file.stat().st_size))
    written = time.monotonic()
    watch = Watch(VirtualBus(ring.bus_directory, "t"))
    until(lambda: pushing(watch, written + 0.3), "force on the bus again", 20)
    assert controller.poll() is None, text(controller)


def test_desk_device_is_selected_by_name(ring):
    """Controller and virtual device of another type than the default: its own joints in records, each force along one of its slides."""
    hand = ring.directory / "desk.csv"
    hand.write_text("time_s,x_m,y_m,z_m\n0,0,0,0.10\n1,0.01,-0.01,0.13\n2,0,0,0.10\n")
    ring.device("--device-type", "desk", "--hand", hand, "--repeat")
    controller = ring.controller("--device-type", "desk", "--samples", ring.samples(), "--duration", 3, "--record", ring.directory / "r.csv", "--json", ring.directory / "c.json")
    assert controller.wait(timeout=60) == 0, text(controller)
    with open(ring.directory / "r.csv") as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    assert {"x_m", "y_m", "z_m", "force_x_N", "force_y_N", "force_z_N"} < set(rows[0]) and "grip" not in rows[0]
    felt = [r for r in rows if r["state"] == 3 and r["gain"] == 1]
    assert len(felt) > 200 and max(r["x_m"] for r in rows) > 0.008
    for r in felt:
        assert (r["force_x_N"], r["force_y_N"], r["force_z_N"]) == pytest.approx((r["fx_N"], r["fy_N"], r["fz_N"]), abs=1e-5)
    assert sorted(r["fz_N"] for r in felt)[len(felt) // 2] == pytest.approx(-FORCE_N, rel=0.02)


@pytest.mark.parametrize("program, words, says", [
    ("haptic-rt", ["--device-type", "desck"], "'desck' is not a device type; haptic-rt --list lists them"),
    ("haptic-rt", ["--set", "force_max_N=3", "--device-type", "desk"], "comes after --profile or --set; put it before them"),
    ("haptic-rt", ["--device-type", "desk", "--set", "joint_min=0,0,0,0,0"], "give 3 value(s)"),
    ("tm-device", ["--device-type", "desk", "--start", "0,0,0.1,0,0"], "a desk has 3 joints")])
def test_unsuitable_device_type_is_rejected(bin, program, words, says):
    run = subprocess.run([bin / program, "--bus", "virtual:t", *words], capture_output=True, text=True, timeout=60)
    assert run.returncode == 2 and says in run.stderr
