"""Common behaviour of all programs: place of output, termination, shared options."""
import json
import os
import re
import signal
import stat
import subprocess
import threading
import time

import pytest

PROGRAMS = ["tm-sim", "tm-mesh", "tm-scene", "tm-view", "tm-play", "tm-precompute", "tm-evaluate", "tm-accuracy", "tm-stability", "haptic-rt", "tm-device"]


def run(*command, **keys):
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=300, **keys)


@pytest.fixture(scope="module")
def scene(root):
    return root / "apps/scenes/block-press.yaml"


@pytest.fixture(scope="module")
def mesh(root):
    return root / "meshes/block_1k.msh"


# --- output ---

def test_output_to_stdout_contains_nothing_else(bin, scene, mesh):
    for path in ("-", "/dev/stdout"):
        out = run(bin / "tm-sim", scene, "--lockstep", "--frames", 2, "--json", path)
        assert out.returncode == 0 and json.loads(out.stdout)["frames"] == 2
        assert "2 frames" in out.stderr  # messages for people
    assert json.loads(run(bin / "tm-mesh", "info", "--json", "-", mesh).stdout)["tets"] > 1000
    out = run(bin / "tm-sim", scene, "--lockstep", "--frames", 2, "--csv", "-", "--json", "-")
    assert out.returncode == 2 and "two outputs go to stdout; write one of them to a file" in out.stderr


def test_stdout_appends_to_a_shared_file(bin, scene, tmp_path):
    for _ in range(2):
        with open(tmp_path / "all.txt", "ab") as file:
            subprocess.run([bin / "tm-sim", scene, "--lockstep", "--frames", "1", "--quiet", "--json", "/dev/stdout"], stdout=file, check=True, timeout=300)
    assert (tmp_path / "all.txt").read_text().count('"frames":\t1') == 2


def test_pipes_and_links_are_written_through_and_kept(bin, scene, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    got = []
    reader = threading.Thread(target=lambda: got.append((tmp_path / "pipe").read_text()))
    reader.start()
    (tmp_path / "link.csv").symlink_to("real.csv")
    out = run(bin / "tm-sim", scene, "--lockstep", "--frames", 2, "--json", tmp_path / "pipe", "--csv", tmp_path / "link.csv")
    reader.join(20)
    assert out.returncode == 0, out.stderr
    assert json.loads(got[0])["frames"] == 2 and stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)
    assert (tmp_path / "link.csv").is_symlink() and len((tmp_path / "real.csv").read_text().splitlines()) > 2
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link.csv", "pipe", "real.csv"]


def test_a_device_stays_a_device(bin, scene, tmp_path):
    node = tmp_path / "null"
    try:
        os.mknod(node, stat.S_IFCHR | 0o666, os.makedev(1, 3))
    except PermissionError:
        node = "/dev/null"  # an ordinary user can neither replace it nor create files beside it
    assert run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, "--json", node).returncode == 0
    assert stat.S_ISCHR(os.stat(node).st_mode)
    lost = run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, "--json", "/dev/full")
    assert lost.returncode == 1 and "/dev/full: cannot be written" in lost.stderr


@pytest.mark.parametrize("command", ["tm-sim {scene} --lockstep --duration 100000000s --json", "tm-sim {scene} --lockstep --duration 100000000s --snapshot-at 1s --snapshot", "tm-evaluate --study --json", "tm-accuracy --json", "tm-stability --json",
                                     "tm-view {scene} --png", "tm-view {scene} --png {tmp}/a.png --json", "tm-mesh info {mesh} --json",
                                     "haptic-rt --bus virtual:alike --duration 100000 --json", "tm-device --bus virtual:alike --duration 100000 --json",
                                     "tm-play --json"])
def test_a_folder_is_refused_before_the_run(bin, root, scene, mesh, tmp_path, command):
    folder = tmp_path / "folder.png"
    folder.mkdir()
    words = command.format(scene=scene, mesh=mesh, tmp=tmp_path).split()
    out = run(bin / words[0], *words[1:], folder, cwd=root, env=dict(os.environ, TM_BUS_DIR=str(tmp_path)))
    assert out.returncode == 2 and f"{folder}: is a folder; give a file name in that folder" in out.stderr


@pytest.mark.parametrize("words", ["tm-view {mesh} --png {tmp}/x.jpg", "tm-view {mesh} --video {tmp}/x.avi", "tm-play --png {tmp}/x.jpg", "tm-sim {scene} --settle 1e-3 --write {tmp}/x.txt"])
def test_wrong_file_ending_is_rejected(bin, scene, mesh, tmp_path, words):
    words = words.format(scene=scene, mesh=mesh, tmp=tmp_path).split()
    out = run(bin / words[0], *words[1:])
    assert out.returncode == 2 and ("this ending" in out.stderr or "one of these endings" in out.stderr) and not list(tmp_path.iterdir())


def test_a_killed_run_leaves_nothing(bin, scene, tmp_path):
    (tmp_path / "o.json.12345~").write_text("of a run killed where files cannot be unnamed")
    p = subprocess.Popen([bin / "tm-sim", scene, "--lockstep", "--duration", "1000000 s", "--csv", tmp_path / "o.csv", "--json", tmp_path / "o.json"])
    time.sleep(0.7)
    assert p.poll() is None
    p.kill()
    p.wait()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", ["haptic-rt --params", "tm-device --params", "tm-sim --schema markdown", "tm-stability --list"] + [f"{p} --help" for p in PROGRAMS])
def test_a_full_disk_under_stdout_is_told(bin, words):
    program, *rest = words.split()
    with open("/dev/full", "w") as full:
        out = subprocess.run([bin / program, *rest], stdout=full, stderr=subprocess.PIPE, text=True, timeout=300)
    assert out.returncode == 1 and "stdout: cannot be written: No space left on device" in out.stderr


# --- signals ---

def slow(bin, scene, *more):
    """The signal arrives inside a frame of a million substeps."""
    p = subprocess.Popen([bin / "tm-sim", scene, "--lockstep", "--set", "tissue.materials.*.young=1e13", *more], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    time.sleep(1)
    assert p.poll() is None
    return p


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run_inside_a_frame(bin, scene, tmp_path, number):
    p = slow(bin, scene, "--json", tmp_path / "o.json")
    p.send_signal(number)
    _, said = p.communicate(timeout=120)
    assert p.returncode == 128 + number and "interrupted after frame 0 of " in said
    assert json.loads((tmp_path / "o.json").read_text())["interrupted"] is True


def test_incomplete_frame_is_not_written(bin, scene, tmp_path):
    """A snapshot of frame 1 stays as it is if the run is ended inside frame 2."""
    snapshot = tmp_path / "s.tms"
    p = subprocess.Popen([bin / "tm-sim", scene, "--lockstep", "--unset", "haptics", "--set", "tissue.materials.*.young=2e11", "--json", tmp_path / "o.json",
                          "--snapshot-at", "0.04 s", "--snapshot", snapshot], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    while not snapshot.exists():
        assert p.poll() is None
        time.sleep(0.01)
    before = snapshot.read_bytes()
    time.sleep(0.2)
    p.send_signal(signal.SIGINT)
    assert p.wait(timeout=120) == 130
    report = json.loads((tmp_path / "o.json").read_text())
    assert snapshot.read_bytes() == before and report["frames"] >= 1


@pytest.mark.parametrize("words", ["tm-precompute {scenes}/liver-press.yaml --out {tmp}/r", "tm-sim {scenes}/evaluate-precomputed.yaml --lockstep --json {tmp}/o.json"])
def test_signal_ends_precomputation(bin, root, tmp_path, words):
    words = words.format(scenes=root / "apps/scenes", tmp=tmp_path).split()
    p = subprocess.Popen([bin / words[0], *words[1:]], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, env=dict(os.environ, TM_CACHE_DIR=str(tmp_path / "cache")))
    for _ in range(1000):  # as soon as it receives
        caught = next(line for line in open(f"/proc/{p.pid}/status") if line.startswith("SigCgt"))
        if int(caught.split()[1], 16) & 1 << (signal.SIGTERM - 1):
            break
        time.sleep(0.005)
    p.send_signal(signal.SIGTERM)
    _, said = p.communicate(timeout=300)
    assert p.returncode == 143 and f"{words[0]}: interrupted; nothing was written" in said
    assert [f.name for f in tmp_path.iterdir() if f.name != "cache"] == []


def test_absurd_numbers_of_substeps_are_warned_of_or_rejected(bin, scene):
    out = run(bin / "tm-sim", scene, "--check", "--set", "tissue.materials.*.young=1e13")
    assert out.returncode == 0 and re.search(r"warning: a frame takes 1\.\d+e\+06 substeps of 3\.\d+e-08 s because of tetrahedron \d+; check its material", out.stderr)
    out = run(bin / "tm-sim", scene, "--check", "--strict", "--set", "tissue.materials.*.young=1e13")
    assert out.returncode == 2
    out = run(bin / "tm-sim", scene, "--check", "--set", "tissue.materials.*.young=1e15", "--set", "time.frame_rate=1")
    assert out.returncode == 2 and "a frame would take 2.6" in out.stderr and "e+08 substeps of " in out.stderr and "check its material" in out.stderr


# --- options ---

@pytest.mark.parametrize("program", PROGRAMS)
def test_help_and_version(bin, program):
    short, long = run(bin / program, "-h"), run(bin / program, "--help")
    assert short.returncode == long.returncode == 0 and short.stdout == long.stdout and "--version" in long.stdout
    assert run(bin / program, "--version").stdout.startswith(program + " ")


LISTS = {"tm-sim": ["block-press.yaml  A block pressed by a probe", "contact", "hybrid"], "tm-mesh": ["refine"], "tm-stability": ["\n"], "tm-evaluate": ["broyden", "hybrid"],
         "tm-accuracy": ["precision"], "haptic-rt": ["position", "cautery", "socketcan:"]}


@pytest.mark.parametrize("program", LISTS)
def test_list_options_print_their_names(bin, program):
    out = run(bin / program, "--list")
    assert out.returncode == 0 and out.stderr == "" and all(word in out.stdout for word in LISTS[program])
    names = {"tm-accuracy": "--knob", "tm-stability": "--case"}.get(program)
    if names:  # every listed name is accepted
        first = out.stdout.split()[0]
        said = run(bin / program, names, first, "--nonsense").stderr
        assert "unknown option, or its value is missing" in said and first not in said


def test_extrapolators_that_are_listed_are_taken(bin, tmp_path):
    names = run(bin / "haptic-rt", "--list").stdout.splitlines()[0].split()[1:]
    assert len(names) > 5
    for name in names:
        assert "--extrapolator" not in run(bin / "haptic-rt", "--extrapolator", name).stderr  # the name is accepted: the program goes on to ask for a bus


def test_quiet_prints_warnings_and_errors_only(bin, scene, mesh, tmp_path):
    env = dict(os.environ, TM_BUS_DIR=str(tmp_path), TM_CACHE_DIR=str(tmp_path / "cache"))
    for command in (["tm-sim", scene, "--lockstep", "--frames", 2], ["tm-sim", scene, "--realtime", "--frames", 2, "--unset", "haptics"], ["tm-mesh", "check", mesh],
                    ["tm-mesh", "convert", mesh, "-o", tmp_path / "a.msh"], ["tm-mesh", "repair", mesh, "-o", tmp_path / "b.msh"],
                    ["tm-mesh", "refine", "--region", "tissue", "--size", "20mm", mesh, "-o", tmp_path / "c.msh"],
                    ["tm-precompute", scene, "--out", tmp_path / "r"], ["tm-stability", "--quick", "--case", run(bin / "tm-stability", "--list").stdout.split()[0]],
                    ["tm-device", "--bus", "virtual:quiet", "--duration", 0.1]):
        loud, still = run(bin / command[0], *command[1:], env=env), run(bin / command[0], *command[1:], "--quiet", env=env)
        assert loud.returncode == still.returncode == 0 and still.stdout == "", still
        assert loud.stdout or command[0] == "tm-device"
    assert run(bin / "tm-mesh", "check", "--quiet", tmp_path / "none.msh").returncode == 2  # warnings and errors are still printed
    assert run(bin / "tm-mesh", "check", "--quiet", tmp_path / "none.msh").stderr
    for program in PROGRAMS:
        assert "--quiet" in run(bin / program, "--help").stdout


@pytest.mark.parametrize("program", ["tm-sim", "tm-view", "tm-play", "haptic-rt", "tm-device"])
def test_network_option_has_one_name(bin, program):
    assert "--lcm-url URL" in run(bin / program, "--help").stdout


def test_old_network_option_still_works(bin, scene, tmp_path):
    for name in ("--url", "--lcm-url"):
        out = run(bin / "tm-sim", scene, "--realtime", "--frames", 1, name, "nonsense://")
        assert out.returncode != 0 and "nonsense" in out.stderr
        out = run(bin / "haptic-rt", "--bus", "virtual:alike", "--duration", 0.1, name, "nonsense://", env=dict(os.environ, TM_BUS_DIR=str(tmp_path)))
        assert out.returncode == 2 and "nonsense" in out.stderr


def test_messages_use_the_singular_for_one(bin, scene):
    out = run(bin / "tm-sim", scene, "--check", "--set", "time.frame_rate=2000", "--set", "tissue.materials.*.young=1 kPa")
    assert ", 1 substep of " in out.stdout


def test_the_device_prints_its_profile(bin, tmp_path):
    out = run(bin / "tm-device", "--params")
    assert out.returncode == 0 and "counts_per_unit" in out.stdout
    (tmp_path / "p").write_text(out.stdout)
    assert run(bin / "tm-device", "--profile", tmp_path / "p", "--params").stdout == out.stdout
