"""tm-view from the command line: logs, pictures, live, video, and messages that must be rejected."""
import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import time

import pytest
from kit import NETWORK, UNSHARE

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import synthetic  # noqa: E402

SMALL = ["--size", "320x240", "--quality", "0"]


def run(bin, *args, env=None, timeout=400):
    return subprocess.run([str(bin / "tm-view"), *map(str, args)], capture_output=True, text=True, timeout=timeout, env=env)


@pytest.fixture(scope="session")
def python_types(build):
    return build / "python"


@pytest.fixture(scope="session")
def log(tmp_path_factory, python_types):
    path = tmp_path_factory.mktemp("log") / "session.lcm"
    synthetic.write_log(python_types, path, seconds=2.0)
    return path


def pixels(path):
    from matplotlib import image

    return image.imread(str(path))[..., :3]


def share(picture, test):
    """Returns the share of pixels for which test(r, g, b) holds."""
    r, g, b = picture[..., 0], picture[..., 1], picture[..., 2]
    return float(test(r, g, b).mean())


def tissue_red(r, g, b):
    return (r > 2 * g) & (r > 2 * b) & (r > 0.15)


def drape(r, g, b):
    return (b > 1.3 * r) & (g > 1.2 * r)


def arrow_amber(r, g, b):
    return (r > 0.75) & (g > 0.6) & (b < 0.4)


def test_picture_shows_tissue_drape_and_force(bin, log, tmp_path):
    out, bare = tmp_path / "words.png", tmp_path / "bare.png"
    assert run(bin, log, "--at", "1.5", "--png", out, "--size", "640x480").returncode == 0
    assert run(bin, log, "--at", "1.5", "--png", bare, "--size", "640x480", "--no-words").returncode == 0
    picture = pixels(bare)
    assert picture.shape == (480, 640, 3)
    assert 0.10 < share(picture, tissue_red) < 0.6
    assert share(picture, drape) > 0.2
    assert share(picture, arrow_amber) > 0.0005
    assert abs(pixels(out) - picture).max() > 0.3  # the words


def test_arrow_follows_the_force(bin, log, tmp_path):
    """At 0.1 s the synthetic force is a tenth of that at 1.5 s."""
    parts = []
    for at in ("0.1", "1.5"):
        out = tmp_path / f"{at}.png"
        assert run(bin, log, "--at", at, "--png", out, "--size", "640x480", "--no-words").returncode == 0
        parts.append(share(pixels(out), arrow_amber))
    assert parts[1] > 5 * max(parts[0], 1e-5)


def test_cut_surface_is_coloured_apart(bin, log, tmp_path):
    """Cut flesh is pink, the outer surface dark red: nothing else in the picture is pink."""

    def pink(r, g, b):
        return (r > 0.7) & (g > 0.25) & (g < 0.75 * r) & (b > 0.2) & (b < 0.75 * r)

    parts = []
    for at in ("0.9", "2.0"):
        out = tmp_path / f"{at}.png"
        assert run(bin, log, "--at", at, "--png", out, "--size", "640x480", "--no-words").returncode == 0
        parts.append(share(pixels(out), pink))
    assert parts[1] > parts[0] + 0.01


def test_same_log_same_bytes(bin, log, tmp_path):
    for name in ("a", "b"):
        assert run(bin, log, "--frames", tmp_path / name, "--to", "0.3", "--size", "320x240").returncode == 0
    first = sorted((tmp_path / "a").iterdir())
    assert [p.name for p in first] == [f"frame_{i:05d}.png" for i in range(10)]
    for p in first:
        assert p.read_bytes() == (tmp_path / "b" / p.name).read_bytes()
    assert first[0].read_bytes() != first[-1].read_bytes()


def probe(path):
    run = subprocess.run(["ffprobe", "-v", "error", "-count_frames", "-select_streams", "v", "-of", "json", "-show_entries",
                          "stream=codec_name,width,height,nb_read_frames,r_frame_rate", str(path)], capture_output=True, text=True, check=True)
    return json.loads(run.stdout)["streams"][0]


@pytest.mark.parametrize("fps,frames", [(30, 61), (12, 25)])
def test_video_of_a_log_is_written(bin, log, tmp_path, fps, frames):
    film, figures = tmp_path / "film.mp4", tmp_path / "figures.json"
    result = run(bin, log, "--video", film, "--json", figures, "--fps", fps, *SMALL)
    assert result.returncode == 0, result.stderr
    stream = probe(film)
    assert (stream["codec_name"], stream["width"], stream["height"], int(stream["nb_read_frames"])) == ("h264", 320, 240, frames)
    assert stream["r_frame_rate"] == f"{fps}/1"
    report = json.loads(figures.read_text())
    assert report["pictures"] == frames and report["messages_refused"] == 0
    assert report["log_tissues"] == 61 and report["log_seconds"] == pytest.approx(2.0, abs=1e-3)
    assert report["peak_force_N"] == pytest.approx(1.8, rel=0.1)
    assert os.listdir(tmp_path) == ["film.mp4", "figures.json"] or sorted(os.listdir(tmp_path)) == ["figures.json", "film.mp4"]


def test_png_and_video_of_one_log(bin, log, tmp_path):
    assert run(bin, log, "--video", tmp_path / "f.mp4", "--png", tmp_path / "p.png", "--at", "1", "--to", "0.5", *SMALL).returncode == 0
    assert int(probe(tmp_path / "f.mp4")["nb_read_frames"]) == 16
    assert pixels(tmp_path / "p.png").shape == (240, 320, 3)


def test_picture_of_a_mesh_and_of_a_scene(bin, root, tmp_path):
    mesh, scene = tmp_path / "mesh.png", tmp_path / "scene.png"
    result = run(bin, root / "meshes" / "liver_1k.msh", "--png", mesh, "--size", "640x480", "--no-words")
    assert result.returncode == 0, result.stderr
    assert share(pixels(mesh), tissue_red) > 0.1
    result = run(bin, root / "apps" / "scenes" / "liver-press.yaml", "--png", scene, "--size", "640x480", "--no-words")
    assert result.returncode == 0, result.stderr
    picture = pixels(scene)
    assert share(picture, tissue_red) > 0.1
    assert share(picture, lambda r, g, b: (abs(r - g) < 0.04) & (r < 0.3)) > 0.001  # the dark shaft


def held_green(r, g, b):
    return (g > 1.6 * r) & (g > 1.15 * b) & (g > 0.25)


def fibre_pale(r, g, b):
    return (r > 0.55) & (g > 0.5) & (b > 0.4) & (r > b)


def test_supports_and_fibres_of_a_scene(bin, root, tmp_path):
    scene = root / "apps" / "scenes" / "cylinder-fibre.yaml"
    parts = {}
    for name, options in {"plain": ["--no-supports"], "held": [], "fibres": ["--no-supports", "--fibres"]}.items():
        result = run(bin, scene, "--png", tmp_path / f"{name}.png", "--size", "640x480", "--no-words", "--azimuth", "-150", *options)
        assert result.returncode == 0, result.stderr
        picture = pixels(tmp_path / f"{name}.png")
        parts[name] = share(picture, held_green), share(picture, fibre_pale)
    assert parts["held"][0] > 0.0002 + parts["plain"][0] and parts["held"][1] < parts["plain"][1] + 0.002
    assert parts["fibres"][1] > 0.01 + parts["plain"][1]


def test_a_log_is_shown_with_its_scene(bin, build, root, tmp_path):
    """Title and supports are in the scene, not in the messages: for a log they are shown if the scene is named."""
    scene, log = root / "apps/scenes/liver-press.yaml", tmp_path / "s.lcm"
    subprocess.run([build / "bin/tm-sim", scene, "--lockstep", "--duration", "0.3 s", "--record", log], check=True, capture_output=True, timeout=300)
    renamed = tmp_path / "renamed.yaml"
    renamed.write_text(scene.read_text().replace("../../", f"{root}/").replace("title: A liver pressed by a probe", "title: Something else altogether"))
    shown = {}
    for name, options in {"bare": [], "scene": ["--scene", scene], "renamed": ["--scene", renamed], "free": ["--scene", scene, "--no-supports"]}.items():
        result = run(bin, log, "--png", tmp_path / f"{name}.png", "--size", "640x480", "--quality", "0", "--elevation", "20", "--azimuth", "70", *options)
        assert result.returncode == 0, result.stderr
        shown[name] = pixels(tmp_path / f"{name}.png")
    assert share(shown["scene"], held_green) > 0.002 + share(shown["free"], held_green)
    top = slice(0, 40), slice(0, 320)
    assert abs(shown["scene"][top] - shown["renamed"][top]).max() > 0.3 and abs(shown["scene"][top] - shown["bare"][top]).max() > 0.3
    assert (shown["scene"][150:] == shown["renamed"][150:]).all()


def test_force_seen_end_on_is_a_ring(bin, log, tmp_path):
    """At 1.5 s the synthetic force points up; seen from above its arrow was once a filled disc."""
    out = tmp_path / "ring.png"
    assert run(bin, log, "--at", "1.5", "--png", out, "--size", "640x480", "--no-words", "--elevation", "85").returncode == 0
    picture = pixels(out)
    r, g, b = picture[..., 0], picture[..., 1], picture[..., 2]
    rows, columns = arrow_amber(r, g, b).nonzero()
    box = arrow_amber(r, g, b)[rows.min():rows.max() + 1, columns.min():columns.max() + 1]
    assert min(box.shape) > 12 and 0.15 < box.mean() < 0.6, (box.shape, box.mean())


def test_the_force_plot_has_a_time_axis(bin, log, tmp_path):
    """Marks at whole seconds since the source began, below the zero line; six seconds wide, now at the right."""
    out = tmp_path / "plot.png"
    assert run(bin, log, "--at", "1.5", "--png", out, "--size", "640x480", "--quality", "0").returncode == 0
    below = pixels(out)[450:452].mean(axis=(0, 2))
    cap, left = 8, 2.4 * 8 - 8
    x0, x1 = left + 5 * cap, 640 - left - cap
    for second in (0, 1):
        x = round(x1 - (x1 - x0) / 6 * (1.5 - second))
        assert below[x - 1:x + 2].max() > below[x - 8:x - 4].max() + 0.1, second


TIED = """\
tissue: {materials: {"*": {young: 5 kPa, poisson: 0.4}}}
bodies: {low: {mesh: BLOCK, scale: 0.5}, high: {mesh: BLOCK, scale: 0.5, move: [0, 0, 50 mm]}}
damping: {rate: 60 /s}
gravity:
rendering:
supports: [{group: low.z_min}, {group: high.z_max}]
ties: {between: [{from: high.z_min, to: low.z_max, within: 30 mm, stiffness: 30 N/m, rest: 5 mm, break: 1.2 N}]}
"""


def cream(r, g, b):
    return (r > 0.5) & (g > 0.75 * r) & (b < 0.85 * g) & (b > 0.3 * g)


def test_ties_are_drawn_until_they_break(bin, build, root, tmp_path):
    """Each pulls with 0.6 N at first; all break at a load of 0.1 N. A viewer that is late has seen no CUT, and a run that continues a snapshot sends none."""
    import lcm

    scene, seen = tmp_path / "tied.yaml", {}
    scene.write_text(TIED.replace("BLOCK", str(root / "meshes/block_1k.msh")))
    tie = ["--set", "ties.between[0].break=0.1 N"]
    for name, more in {"whole": [], "broken": [*tie, "--snapshot-at", "0.12 s", "--snapshot", tmp_path / "a.snap"], "restored": [*tie, "--restore", tmp_path / "a.snap"]}.items():
        subprocess.run([build / "bin/tm-sim", scene, "--lockstep", "--duration", "0.2 s", *more, "--record", tmp_path / f"{name}.lcm"], check=True, capture_output=True, timeout=300)
    events, late = list(lcm.EventLog(str(tmp_path / "broken.lcm"))), lcm.EventLog(str(tmp_path / "late.lcm"), "w", overwrite=True)
    last_cut = max(i for i, e in enumerate(events) if e.channel == "CUT")
    for e in events[last_cut + 1:]:
        late.write_event(e.timestamp, e.channel, e.data)
    late.close()
    for name in ("whole", "broken", "late", "restored"):
        result = run(bin, tmp_path / f"{name}.lcm", "--png", tmp_path / f"{name}.png", "--size", "320x240", "--no-words", "--no-supports", "--elevation", "5")
        assert result.returncode == 0, result.stderr
        seen[name] = share(pixels(tmp_path / f"{name}.png"), cream)
    assert seen["whole"] > 0.003 and seen["broken"] == seen["late"] == seen["restored"] == 0, seen


def test_a_plane_hides_the_ties_beyond_it(bin, root, tmp_path):
    """Halves of a scene before its first frame; and a plane that ties do not reach."""
    scene, seen = tmp_path / "tied.yaml", {}
    scene.write_text(TIED.replace("BLOCK", str(root / "meshes/block_1k.msh")))
    for name, plane in {"whole": [], "low": ["--clip", "0,0,1,-20"], "half": ["--clip", "0,-1,0,0"]}.items():
        result = run(bin, scene, *plane, "--png", tmp_path / "p.png", "--size", "320x240", "--no-words", "--no-supports", "--elevation", "5")
        assert result.returncode == 0, result.stderr
        seen[name] = share(pixels(tmp_path / "p.png"), cream)
    assert seen["whole"] > 0.003 and seen["low"] == 0 and 0 < seen["half"] < seen["whole"], seen


def test_a_rigid_body_is_grey_and_not_held(bin, root, tmp_path):
    """The largest region is tissue, also if a rigid one is larger."""
    scene = tmp_path / "table.yaml"
    scene.write_text("""\
tissue: {materials: {"*": {young: 5 kPa, poisson: 0.4}}}
bodies: {table: {mesh: BLOCK, rigid: yes}, soft: {mesh: BLOCK, scale: 0.5, move: [20 mm, 20 mm, 51 mm]}}
""".replace("BLOCK", str(root / "meshes/block_1k.msh")))
    result = run(bin, scene, "--png", tmp_path / "table.png", "--size", "320x240", "--no-words")
    assert result.returncode == 0, result.stderr
    picture = pixels(tmp_path / "table.png")
    grey = share(picture, lambda r, g, b: (r > 0.35) & (abs(r - g) < 0.06) & (abs(g - b) < 0.06))
    assert 0.01 < share(picture, tissue_red) < 0.1 and grey > 0.05, (share(picture, tissue_red), grey)


def test_scene_errors_are_the_scenes(bin, tmp_path):
    scene = tmp_path / "bad.yaml"
    scene.write_text("title: x\ntisue:\n  mesh: nowhere.msh\n")
    result = run(bin, scene, "--png", tmp_path / "x.png")
    assert result.returncode == 2 and "bad.yaml:2:" in result.stderr, result.stderr
    assert not (tmp_path / "x.png").exists()


BAD = [
    (["LOG", "--png", "OUT", "--fibres"], "--fibres needs the scene"),
    (["any.yaml", "--png", "OUT", "--scene", "x.yaml"], "--scene applies to a log"),
    (["LOG", "--png", "OUT", "--scene", "nowhere.yaml"], "nowhere.yaml: "),
    ([], "the output is missing"),
    (["--png"], "--png"),
    (["--colour", "red"], "unknown option"),
    (["LOG", "LOG", "--png", "OUT"], "one source"),
    (["LOG", "--png", "OUT", "--size", "12x"], "--size"),
    (["LOG", "--png", "OUT", "--size", "9000x100"], "--size"),
    (["LOG", "--video", "OUT", "--size", "641x480"], "even"),
    (["LOG", "--video", "OUT", "--fps", "0"], "--fps"),
    (["LOG", "--png", "OUT", "--fps", "2.5"], "whole number"),
    (["LOG", "--png", "OUT", "--zoom", "nan"], "--zoom"),
    (["LOG", "--png", "OUT", "--up", "w"], "--up"),
    (["LOG", "--png", "OUT", "--shift", "1"], "--shift"),
    (["LOG", "--png", "OUT", "--quality", "7"], "--quality"),
    (["LOG", "--video", "OUT", "--from", "3", "--to", "1"], "--to is before"),
    (["LOG", "--video", "OUT", "--from", "60"], "lasts 2.00 s"),
    (["LOG", "--png", "OUT", "--at", "60"], "lasts 2.00 s"),
    (["nowhere.lcm", "--png", "OUT"], "cannot be read: No such file or directory"),
    (["TEXT/log.lcm", "--png", "OUT"], "cannot be read: Not a directory"),
    (["nowhere.msh", "--png", "OUT"], "nowhere.msh"),
    (["nowhere.yaml", "--png", "OUT"], "nowhere.yaml"),
    (["TEXT", "--png", "OUT"], "not an LCM log"),
    (["EMPTY", "--png", "OUT"], "not an LCM log"),
    (["FOREIGN", "--png", "OUT"], "no TISSUE"),
    (["LOG", "--png", "FOLDER/no/p.png"], "cannot write"),
    (["LOG", "--video", "FOLDER/no/p.mp4"], "cannot write"),
    (["LOG", "--frames", "FOLDER/no/p"], "cannot be made"),
]


@pytest.mark.parametrize("args,said", BAD, ids=lambda v: " ".join(v) if isinstance(v, list) else None)
def test_bad_input(bin, log, tmp_path, python_types, args, said):
    import lcm

    (tmp_path / "text").write_text("this is no log\n" * 100)
    (tmp_path / "empty").write_bytes(b"")
    foreign = lcm.EventLog(str(tmp_path / "foreign"), "w", overwrite=True)
    foreign.write_event(1, "OTHER", b"data")
    foreign.close()
    before = sorted(os.listdir(tmp_path))
    names = {"LOG": log, "OUT": tmp_path / ("out.mp4" if "--video" in args else "out.png"), "TEXT": tmp_path / "text", "EMPTY": tmp_path / "empty", "FOREIGN": tmp_path / "foreign"}
    result = run(bin, *[str(names.get(a, a)).replace("FOLDER", str(tmp_path)).replace("TEXT/", f"{tmp_path}/text/") for a in args])
    assert result.returncode == 2, result.stderr
    assert said in result.stderr and (";" in result.stderr or "see" in result.stderr), result.stderr
    assert len(result.stderr.strip().splitlines()) == 1, result.stderr
    assert sorted(os.listdir(tmp_path)) == before


def test_help_and_version(bin):
    for option in ("--help", "--version"):
        result = run(bin, option)
        assert result.returncode == 0 and "tm-view" in result.stdout and not result.stderr


def test_no_ffmpeg_says_what_to_install(bin, log, tmp_path):
    result = run(bin, log, "--video", tmp_path / "film.mp4", *SMALL, env={**os.environ, "PATH": str(tmp_path)})
    assert result.returncode == 2 and "apt-get install ffmpeg" in result.stderr
    assert os.listdir(tmp_path) == []


def spoilers():
    """Name, and the change of a frame's tissue or status bytes."""

    def put(data, at, form, value):
        return data[:at] + struct.pack(form, value) + data[at + struct.calcsize(form):]

    def count_at(data):
        return struct.unpack(">i", data[40:44])[0]

    def triangle_at(data):
        return 44 + 16 * count_at(data) + 4

    return {
        "coordinate not a number": ("TISSUE", lambda d: put(d, 44 + 12 * 7, ">f", float("nan"))),
        "coordinate infinite": ("TISSUE", lambda d: put(d, 44, ">f", float("inf"))),
        "triangle past the vertices": ("TISSUE", lambda d: put(d, triangle_at(d) + 12 * 5, ">i", count_at(d))),
        "triangle negative": ("TISSUE", lambda d: put(d, triangle_at(d), ">i", -1)),
        "vertex count negative": ("TISSUE", lambda d: put(d, 40, ">i", -5)),
        "vertex count enormous": ("TISSUE", lambda d: put(d, 40, ">i", 2**31 - 1)),
        "kind unknown": ("TISSUE", lambda d: put(d, len(d) - 37, ">b", 9)),
        "more ties hold than there are": ("TISSUE", lambda d: put(d, len(d) - 36, ">i", 0)),
        "tie count negative": ("TISSUE", lambda d: put(d, len(d) - 32, ">i", -1)),
        "tie count enormous": ("TISSUE", lambda d: put(d, len(d) - 32, ">i", 1 << 24)),
        "ties more than can be drawn": ("TISSUE", lambda d: put(d, len(d) - 36, ">i", 2**31 - 1)),
        "tie past the scene's": ("TISSUE", lambda d: put(d, len(d) - 28, ">i", 2)),
        "tie negative": ("TISSUE", lambda d: put(d, len(d) - 28, ">i", -1)),
        "end of a tie not a number": ("TISSUE", lambda d: put(d, len(d) - 4, ">f", float("nan"))),
        "end of a tie far away": ("TISSUE", lambda d: put(d, len(d) - 24, ">f", 1001)),
        "truncated": ("TISSUE", lambda d: d[: len(d) // 2]),
        "trailing bytes": ("TISSUE", lambda d: d + b"\0\0\0\0"),
        "empty": ("TISSUE", lambda d: b""),
        "other type": ("TISSUE", lambda d: b"\1\2\3\4\5\6\7\x08" + d[8:]),
        "string longer than the message": ("SIM_STATUS", lambda d: put(d, 28, ">i", 1 << 30)),
        "string negative": ("SIM_STATUS", lambda d: put(d, 28, ">i", -1)),
        "force not a number": ("SIM_STATUS", lambda d: put(d, len(d) - 16, ">d", float("nan"))),
        "status truncated": ("SIM_STATUS", lambda d: d[:-3]),
        "controller truncated": ("CONTROLLER_0", lambda d: d[:60]),
        "controller string negative": ("CONTROLLER_1", lambda d: put(d, 34, ">i", -7)),
    }


@pytest.mark.parametrize("name", spoilers())
def test_hostile_messages_are_refused(bin, tmp_path, python_types, name):
    """Valid messages before and after; the bad one changes nothing but the count."""
    channel, spoil = spoilers()[name]
    clean, dirty = tmp_path / "clean.lcm", tmp_path / "dirty.lcm"

    def add(session, frame, messages):
        return messages + [(c, spoil(d)) for c, d in messages if c == channel] if frame == 3 else messages

    synthetic.write_log(python_types, clean, seconds=0.2, rows=8)
    synthetic.write_log(python_types, dirty, seconds=0.2, rows=8, spoil=add)
    for path in (clean, dirty):
        result = run(bin, path, "--frames", tmp_path / path.stem, "--json", tmp_path / f"{path.stem}.json", "--size", "128x96", "--quality", "0")
        assert result.returncode == 0, result.stderr
    assert json.loads((tmp_path / "clean.json").read_text())["messages_refused"] == 0
    assert json.loads((tmp_path / "dirty.json").read_text())["messages_refused"] == 1
    assert "refused" in result.stderr and channel in result.stderr
    for frame in sorted((tmp_path / "clean").iterdir()):
        assert frame.read_bytes() == (tmp_path / "dirty" / frame.name).read_bytes()


def test_log_cut_off_in_the_middle(bin, log, tmp_path):
    short = tmp_path / "short.lcm"
    data = log.read_bytes()
    short.write_bytes(data[: len(data) * 2 // 3])
    result = run(bin, short, "--png", tmp_path / "p.png", *SMALL)
    assert result.returncode == 0 and "is damaged or truncated" in result.stderr
    assert (tmp_path / "p.png").exists()


def test_log_with_an_event_of_two_gigabytes(bin, log, tmp_path):
    """An event that announces 0x7fffffff bytes, in the middle and at the end: skipped, and reported."""
    giant = struct.pack(">IqqII", 0xeda1da01, 5, 5, 6, 0x7fffffff) + b"TISSUE" + bytes(50)
    data = log.read_bytes()
    second = data.index(data[:4], 4)
    for name, bad in (("middle", data[:second] + giant + data[second:]), ("end", data + giant)):
        path = tmp_path / f"{name}.lcm"
        path.write_bytes(bad)
        result = run(bin, path, "--png", tmp_path / f"{name}.png", *SMALL)
        assert result.returncode == 0 and "damaged" in result.stderr, result.stderr
    assert (tmp_path / "middle.png").read_bytes() == (tmp_path / "end.png").read_bytes()


# --- live, in a network of its own ---


def namespace_works():
    return subprocess.run([*NETWORK, "true"], capture_output=True).returncode == 0


needs_namespace = pytest.mark.skipif(not namespace_works(), reason="network namespaces are not permitted here")

PUBLISHER = """
import sys, time
sys.path[:0] = [{here!r}]
import synthetic, lcm
types = synthetic.import_types({types!r})
link = lcm.LCM("udpm://239.255.76.67:7667?ttl=0")
for run, pause in ((1, {pause}), (2, 0)):
    session = synthetic.Session(types, 8, session=run)
    for frame in range(45):
        session.seq = frame
        now = int(time.time() * 1e6)
        link.publish("TISSUE", session.tissue(now, frame / 30).encode())
        link.publish("SIM_STATUS", session.status(now, frame / 30).encode())
        time.sleep(1 / 30)
    time.sleep(pause)
"""


@needs_namespace
def test_live_waits_then_shows_and_survives_a_restart(bin, build, tmp_path):
    """tm-view starts first; the simulation comes later, stops for more than a second, and returns with a new session."""
    script = PUBLISHER.format(here=str(HERE), types=str(build / "python"), pause=1.6)
    (tmp_path / "publish.py").write_text(script)
    shell = (f'"{bin}/tm-view" --frames "{tmp_path}/f" --fps 10 --duration 4.2 --json "{tmp_path}/j.json" --size 320x240 --quality 0 & view=$!; '
             f'sleep 1.2; "{sys.executable}" "{tmp_path}/publish.py"; wait $view')
    result = subprocess.run([*NETWORK, "bash", "-c", shell], capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    assert "waiting for TISSUE: start tm-sim" in result.stderr
    figures = json.loads((tmp_path / "j.json").read_text())
    frames = sorted((tmp_path / "f").iterdir())
    assert figures["pictures"] == len(frames) == 42
    assert figures["messages_refused"] == 0 and figures["messages_taken"] > 100
    different = len({p.read_bytes() for p in frames})
    assert different > 15  # it moved, stood still without messages, and moved again
    assert frames[-1].read_bytes() != frames[25].read_bytes()


LARGE = """
import socket, struct, subprocess, sys, time
sys.path[:0] = [{here!r}]
import synthetic, lcm
types = synthetic.import_types({types!r})
link = lcm.LCM("udpm://239.255.76.67:7667?ttl=0")
view = subprocess.Popen([{program!r}, "--frames", {frames!r}, "--fps", "10", "--duration", "90", "--size", "160x120", "--quality", "0"], stderr=subprocess.DEVNULL)
small, large = synthetic.Session(types, 8), synthetic.Session(types, 316, session=78).tissue(1, 0).encode()


def resident_MB():
    return int(next(line for line in open(f"/proc/{{view.pid}}/status") if line.startswith("VmRSS")).split()[1]) // 1024


def send_slowly(data, seq):  # lcm sends all fragments at once, more than a socket holds
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
    data, part = b"TISSUE\\0" + data, 60000
    count = -(-len(data) // part)
    for n in range(count):
        head = struct.pack(">IIIIHH", 0x4c433033, seq, len(data) - 7, max(0, n * part - 7), n, count)
        s.sendto(head + data[n * part:(n + 1) * part], ("239.255.76.67", 7667))
        time.sleep(0.001)


def send_small(seconds, enough=lambda: False):
    end = time.monotonic() + seconds
    while time.monotonic() < end and not enough():
        small.seq += 1
        link.publish("TISSUE", small.tissue(int(time.time() * 1e6), 0.1).encode())
        time.sleep(0.05)


send_small(1.5)
before, largest = resident_MB(), 0
for seq in (1, 2):
    send_slowly(large, seq)
    end = time.monotonic() + 20
    while time.monotonic() < end and resident_MB() < before + 60:
        time.sleep(0.05)
    largest = max(largest, resident_MB())
    send_small(2)
send_small(40, lambda: resident_MB() < before + 100)
print(before, largest, resident_MB())
view.kill()
"""


@needs_namespace
def test_memory_of_a_large_tissue_is_released(bin, build, tmp_path):
    """200,000 vertices, twice, then a small tissue again: the memory is returned to the system."""
    script = LARGE.format(here=str(HERE), types=str(build / "python"), program=str(bin / "tm-view"), frames=str(tmp_path / "f"))
    result = subprocess.run([*NETWORK, sys.executable, "-c", script], capture_output=True, text=True, timeout=200)
    assert result.returncode == 0, result.stderr
    before, largest, after = map(int, result.stdout.split())
    assert largest > before + 60, "the large tissue was not taken"
    assert after < before + 100, f"{before} MB before, {largest} with the large tissue, {after} after it"


@needs_namespace
def test_live_without_a_simulation_gives_up(bin, tmp_path):
    result = subprocess.run([*NETWORK, str(bin / "tm-view"), "--png", str(tmp_path / "p.png"), "--wait", "0.6"], capture_output=True, text=True, timeout=120)
    assert result.returncode == 1 and "no TISSUE message within 0.6 s; start tm-sim" in result.stderr
    assert os.listdir(tmp_path) == []


@needs_namespace
def test_live_without_a_multicast_route_says_what_to_do(bin, tmp_path):
    isolated = UNSHARE
    result = subprocess.run([*isolated, str(bin / "tm-view"), "--png", str(tmp_path / "p.png")], capture_output=True, text=True, timeout=120)
    assert result.returncode == 2 and "ip route add 224.0.0.0/4 dev lo" in result.stderr
    assert os.listdir(tmp_path) == []


def test_random_corruption_ends_nothing(bin, tmp_path, python_types):
    """Bytes changed at random, among valid messages: rejected or drawn, and the picture is still written."""
    import random

    chance = random.Random(7)

    def add(session, frame, messages):
        spoiled = []
        for channel, data in messages:
            for _ in range(20):
                bytes_ = bytearray(data)
                for _ in range(chance.randint(1, 8)):
                    bytes_[chance.randrange(len(bytes_))] = chance.randrange(256)
                spoiled.append((channel, bytes(bytes_)))
        return spoiled + messages

    path, figures = tmp_path / "random.lcm", tmp_path / "figures.json"
    synthetic.write_log(python_types, path, seconds=0.3, rows=8, spoil=add)
    result = run(bin, path, "--frames", tmp_path / "f", "--json", figures, "--size", "128x96", "--quality", "0")
    assert result.returncode == 0, result.stderr
    report = json.loads(figures.read_text())
    assert report["pictures"] == 10 and report["messages_refused"] > 100 and report["vertices"] == 114
