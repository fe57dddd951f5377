"""Choice of the device by name at run time: lockstep renders the same press with every virtual device, and nothing assumes another device's joints."""
import csv
import math
import subprocess

import pytest

SCENE = "apps/scenes/block-press.yaml"
JOINTS = {"impulse_engine": ["pitch_rad", "yaw_rad", "insertion_m", "roll_rad", "grip"], "desk": ["x_m", "y_m", "z_m"]}


def sim(bin, root, *words, code=0):
    run = subprocess.run([bin / "tm-sim", root / SCENE, *map(str, words)], capture_output=True, text=True, timeout=300)
    assert run.returncode == code, run.stderr
    return run


def played(bin, root, tmp_path, device):
    table = tmp_path / f"{device}.csv"
    sim(bin, root, "--lockstep", "--quiet", "--set", f"instruments[0].device={device}", "--csv", table)
    with open(table) as file:
        rows = list(csv.DictReader(file))
    columns = list(rows[0])
    assert columns[columns.index("fz_N") + 1:columns.index("age_s")] == JOINTS[device]
    return [{k: float(v) for k, v in row.items()} for row in rows]


def force(row):
    return math.hypot(row["fx_N"], row["fy_N"], row["fz_N"])


def test_each_device_feels_the_press(bin, root, tmp_path):
    """The fictional desk device follows the same path with the same force, up to its own mass and friction."""
    impulse, desk = (played(bin, root, tmp_path, device) for device in JOINTS)
    peaks = [max(map(force, rows)) for rows in (impulse, desk)]
    assert peaks[0] > 0.4 and peaks[1] == pytest.approx(peaks[0], rel=0.03)
    apart = max(math.dist(*([row[k] for k in ("px_m", "py_m", "pz_m")] for row in pair)) for pair in zip(impulse, desk))
    assert 0 < apart < 3e-4
    for row in desk:  # its joints are the tip's position in its own axes: z down from the trocar, y up
        assert (row["px_m"], row["pz_m"]) == (pytest.approx(0.05 - row["x_m"], abs=1e-7), pytest.approx(0.18 - row["z_m"], abs=1e-7))
    assert all(row["state"] == 3 for row in desk[-200:]) and not any(row["fault"] for row in desk)


def test_its_hand_is_written_in_its_joints(bin, root, tmp_path):
    sim(bin, root, "--set", "instruments[0].device=desk", "--hands", tmp_path / "hand")
    assert (tmp_path / "hand0.csv").read_text().splitlines()[0] == "time_s,x_m,y_m,z_m,active"
    assert '"desk"' in (tmp_path / "hand.json").read_text()


@pytest.mark.parametrize("device", JOINTS)
def test_a_table_without_controllers_has_a_column_for_each_joint(bin, root, tmp_path, device):
    sim(bin, root, "--lockstep", "--quiet", "--frames", "2", "--unset", "haptics", "--set", f"instruments[0].device={device}", "--csv", tmp_path / "t.csv")
    widths = {len(line.split(",")) for line in (tmp_path / "t.csv").read_text().splitlines()}
    assert widths == {12 + len(JOINTS[device])}


@pytest.mark.parametrize("words, says", [
    (["haptics.profile={profile}"], "haptics.profile applies to one type of device, and the instruments have a impulse_engine and a desk"),
    (["instruments[0].profile={profile}", "instruments[1].profile={profile}"], "mine.profile:1: joint_max: '7' is not allowed; give 3 value(s)"),
    (["instruments[0].profile={profile}"], None), (["haptics.profile={profile}", "instruments[1].device=impulse_engine"], None)])
def test_a_profile_is_of_one_device(bin, root, tmp_path, words, says):
    """Two instruments never share a device; each may have its own."""
    profile, scene, text = tmp_path / "mine.profile", tmp_path / "two.yaml", (root / SCENE).read_text()
    profile.write_text("joint_max = 1 1 0.3 7 1\n")
    trocar = "    trocar: [50 mm, 50 mm, 180 mm]\n"
    scene.write_text(text.replace("../..", str(root)).replace(trocar, trocar + "  - mode: probe\n    device: desk\n    trocar: [20 mm, 20 mm, 180 mm]\n"))
    sets = [w for word in words for w in ("--set", word.format(profile=profile))]
    run = subprocess.run([bin / "tm-sim", scene, "--lockstep", "--quiet", "--frames", "2", *sets], capture_output=True, text=True, timeout=60)
    assert run.returncode == (2 if says else 0) and (says or "") in run.stderr, run.stderr


@pytest.mark.parametrize("words, says", [
    (["instruments[0].device=deks"], "device 'deks' is not known; use one of impulse_engine desk"),
    (["instruments[0].device=desk", "hand[0].path[1].roll=0.2 rad"], "the device of instrument 0, desk, has no such joint; leave it out")])
def test_impossible_assignments_are_reported(bin, root, words, says):
    assert says in sim(bin, root, "--check", *(w for word in words for w in ("--set", word)), code=2).stderr
