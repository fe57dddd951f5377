"""tm-organ: a phantom goes from an image, a surface or tetrahedra to a press and a cut with force and video. Completed stages are not repeated; bad input
leaves no files."""
import json
import math
import re
import subprocess
import sys

import numpy as np
import pytest

sys.path[:0] = ["tests/mesh", "tests/scene"]
import meshlib  # noqa: E402
import test_fill  # noqa: E402
from paths import LONG  # noqa: E402
from test_scene import phantom  # noqa: E402

MADE = {"organ.msh", "organ.yaml", "press.lcm", "force.csv", "organ.png", "press.json", "rest.json", "rest.vtk", "mesh.json", "check.txt", "live.json", ".organ.done"}


def organ(bin, *words, code=0):
    out = subprocess.run([str(bin / "tm-organ"), *map(str, words)], capture_output=True, text=True, timeout=400)
    assert out.returncode == code, out.stdout + out.stderr
    return out.stdout + out.stderr


def stl(mesh):
    """Returns the block's outer triangles, as text in millimetres."""
    faces = {}
    for t in mesh.tets:
        for f in ((t[1], t[2], t[3]), (t[0], t[3], t[2]), (t[0], t[1], t[3]), (t[0], t[2], t[1])):
            faces.setdefault(tuple(sorted(f)), []).append(f)
    text = "solid block\n"
    for (f, *more) in faces.values():
        if not more:
            text += "facet normal 0 0 0\nouter loop\n" + "".join("vertex %g %g %g\n" % tuple(1e3 * x for x in mesh.points[v]) for v in f) + "endloop\nendfacet\n"
    return text + "endsolid block\n"


@pytest.fixture(scope="module")
def felt(bin, tmp_path_factory):
    folder = tmp_path_factory.mktemp("organ")
    (folder / "phantom.msh").write_text(meshlib.msh2(phantom()))
    said = organ(bin, folder / "phantom.msh", "-o", folder / "felt", "--video", "160x120")
    return folder, said


def pressed_and_cut(folder):
    """Checks that tetrahedra were removed and the hands' forces recorded: a row per tick of 500 Hz, both hands, never above the device's limit."""
    figures = json.loads((folder / "press.json").read_text())
    assert figures["tets_removed"] > 3 and figures["tets_alive"] + figures["tets_removed"] == figures["tets"]
    rows = np.genfromtxt(folder / "force.csv", delimiter=",", names=True)
    force = np.sqrt(rows["fx_N"] ** 2 + rows["fy_N"] ** 2 + rows["fz_N"] ** 2)
    assert len(rows) > 2 * 500 * 6.3 and not rows["fault"].any()
    for hand, begin, end in ((0, 0.6, 4.4), (1, 3.2, 6)):
        mine, t = force[rows["instrument"] == hand], rows["time_s"][rows["instrument"] == hand]
        assert 0.05 < mine[(t > begin) & (t < end)].max() == mine.max() < 8.9, hand
        assert mine[t > 6.2].max() == 0  # both jobs are done
    return figures


def film_decodes(path):
    """Reads all its pictures; returns the brightness of each, red."""
    raw = subprocess.run(["ffmpeg", "-v", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, timeout=120)
    assert raw.returncode == 0 and not raw.stderr, raw.stderr
    pictures = np.frombuffer(raw.stdout, "u1").reshape(-1, 120, 160, 3).astype(float)
    assert len(pictures) == 160
    organ = np.abs(pictures[:, 45:90, 40:120] - pictures[0, 45:90, 40:120]).mean((1, 2, 3))
    assert organ[60:80].max() > 0.5 and organ[-1] > 0.5  # instruments arrive, and the tissue changes


def test_mesh_becomes_scenes_and_a_video(felt):
    folder, said = felt
    assert {p.name for p in (folder / "felt").iterdir()} == MADE | {"organ.mp4"}
    assert (folder / "felt/organ.png").read_bytes()[:4] == b"\x89PNG"
    cut = pressed_and_cut(folder / "felt")["tets_removed"]
    film_decodes(folder / "felt/organ.mp4")
    assert f"{cut} tetrahedra cut" in said and "7/7 video" in said and "done before" not in said


def test_finished_stages_and_edited_scenes_are_kept(bin, felt):
    folder, _ = felt
    again = ["-o", folder / "felt", "--no-video"]
    assert organ(bin, folder / "phantom.msh", *again).count("(done before)") == 6
    scene = folder / "felt/organ.yaml"
    scene.write_text(scene.read_text().replace("young: 5.5 kPa", "young: 7 kPa"))
    said = organ(bin, folder / "phantom.msh", *again)
    assert said.count("(done before)") == 1 and "yours, kept" in said and "young: 7 kPa" in scene.read_text()
    (folder / "felt/force.csv").unlink()
    said = organ(bin, folder / "phantom.msh", *again)
    assert said.count("(done before)") == 5 and (folder / "felt/force.csv").exists()


def test_from_a_surface(bin, tmp_path):
    (tmp_path / "liver.stl").write_text(stl(meshlib.block(1)))
    said = organ(bin, tmp_path / "liver.stl", "--unit", "mm", "--size", "25mm", "-o", tmp_path / "out", "--no-video", "--no-cut")
    assert {p.name for p in (tmp_path / "out").iterdir()} == MADE
    assert "Roulot" in (tmp_path / "out/organ.yaml").read_text() and "peak" in said  # a tissue named by the file


EVEN_SIM = """#!{python}
import json, pathlib, subprocess, sys
code = subprocess.run(["{sim}", *sys.argv[1:]]).returncode
figures = pathlib.Path(sys.argv[sys.argv.index("--json") + 1]) if "--json" in sys.argv else None
f = json.loads(figures.read_text()) if figures and not code else {{}}
if "busiest_second_s" in f:
    f["busiest_second_s"] = 1e-7 * f["tets"] * f["substeps_per_frame"] / f["frame_s"]
    f["processor_s"] = f["sim_s"] * f["busiest_second_s"]
    figures.write_text(json.dumps(f))
sys.exit(code)
"""


@pytest.fixture(scope="module")
def even_bin(bin, tmp_path_factory):
    """The programs, on a machine of always the same speed: tm-sim reports 0.1 us of processor time for each step of a tetrahedron."""
    folder = tmp_path_factory.mktemp("even")
    (folder / "lib").symlink_to(bin.parent / "lib")
    (folder / "bin").mkdir()
    for program in bin.iterdir():
        (folder / "bin" / program.name).symlink_to(program)
    for name, text in (("tm-organ", (bin / "tm-organ").read_text()), ("tm-sim", EVEN_SIM.format(python=sys.executable, sim=bin / "tm-sim"))):
        (folder / "bin" / name).unlink()
        (folder / "bin" / name).write_text(text)
        (folder / "bin" / name).chmod(0o755)
    return folder / "bin"


def live_figures(folder, said):
    """Processor seconds per simulated second: the reported figure and the press's own."""
    told = re.search(r"half a core, live\s+(?:.*\n)*?.*?([\d.]+) s of a core a second", said)
    return float(told[1]), json.loads((folder / "press.json").read_text())["busiest_second_s"]


def thin_layers():
    """A block of two regions whose layers of tetrahedra are up to 100 times as thin as wide: thousands of substeps."""
    mesh = phantom()
    low, high = min(p[2] for p in mesh.points), max(p[2] for p in mesh.points)
    mesh.points = [(x, y, low + (high - low) * ((z - low) / (high - low)) ** 3) for x, y, z in mesh.points]
    return mesh


def test_small_tetrahedra_are_made_heavier_until_half_a_core_steps_it(even_bin, tmp_path):
    (tmp_path / "thin.msh").write_text(meshlib.msh2(thin_layers()))
    said = organ(even_bin, tmp_path / "thin.msh", "-o", tmp_path / "out", "--no-video", "--no-cut")
    scene, (told, took) = (tmp_path / "out/organ.yaml").read_text(), live_figures(tmp_path / "out", said)
    f = json.loads((tmp_path / "out/live.json").read_text())
    assert took <= 0.5 and told == float(f"{took:.2g}") and "mass_scaling: yes" in scene, said
    assert re.search(r"was [\d.]+: [\d.]+ % of mass is added where tetrahedra are small, lowest frequency", said), said
    assert f["dt_s"] > 1.2 * f["critical_step"]["guaranteed_s"] or f["substeps_per_frame"] < 400
    assert "feel it: tm-session" in said
    assert organ(even_bin, tmp_path / "thin.msh", "-o", tmp_path / "out", "--no-video", "--no-cut").count("(done before)") == 6


def test_edited_scene_is_measured_and_not_changed(even_bin, tmp_path):
    """Its step is so short that half a core does not suffice."""
    (tmp_path / "thin.msh").write_text(meshlib.msh2(thin_layers()))
    words = [tmp_path / "thin.msh", "-o", tmp_path / "out", "--no-video", "--no-cut"]
    organ(even_bin, *words)
    scene = tmp_path / "out/organ.yaml"
    scene.write_text(re.sub(r"time: \{frame_rate.*", "time: {frame_rate: 25 Hz, duration: 1 s, step: 2e-5 s}", scene.read_text()))
    before = scene.read_text()
    said = organ(even_bin, *words)
    assert scene.read_text() == before and "you have edited it, so it is not changed" in said and "too much for real time" in said and "feel it" not in said, said


def test_a_surface_of_odd_shape(even_bin, tmp_path):
    """A star of long arms: fine tetrahedra only where needed."""
    arms = lambda p: 1 + 1.2 * max(abs(x) / math.sqrt(sum(c * c for c in p)) for x in p) ** 6
    star = [tuple(tuple(arms(p) * x for x in p) for p in t) for t in test_fill.sphere(8, 40.0)]
    (tmp_path / "star.stl").write_text(test_fill.text(star))
    said = organ(even_bin, tmp_path / "star.stl", "--unit", "mm", *([] if LONG else ["--size", "14mm"]), "-o", tmp_path / "out", "--no-video")
    told, took = live_figures(tmp_path / "out", said)
    assert took <= 0.5 and told == float(f"{took:.2g}") and "feel it: tm-session" in said, said


def as_obj(text):
    return "".join("v" + line[6:] + "\n" for line in text.splitlines() if line.startswith("vertex")) + "".join(f"f {i} {i + 1} {i + 2}\n" for i in range(1, text.count("vertex"), 3))


def as_ply(text):
    corners = [line[7:] for line in text.splitlines() if line.startswith("vertex")]
    places = sorted(set(corners))
    return (f"ply\nformat ascii 1.0\nelement vertex {len(places)}\nproperty float x\nproperty float y\nproperty float z\nelement face {len(corners) // 3}\nproperty list uchar int vertex_indices\nend_header\n"
            + "\n".join(places) + "\n" + "".join("3 %d %d %d\n" % tuple(places.index(c) for c in corners[i:i + 3]) for i in range(0, len(corners), 3)))


def as_vtp(text):
    corners = [line[7:] for line in text.splitlines() if line.startswith("vertex")]
    places = sorted(set(corners))
    array = lambda kind, name, numbers, more="": f'<DataArray type="{kind}" Name="{name}" {more} format="ascii">{numbers}</DataArray>'
    return (f'<?xml version="1.0"?>\n<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"><PolyData><Piece NumberOfPoints="{len(places)}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" NumberOfPolys="{len(corners) // 3}">'
            + "<Points>" + array("Float32", "Points", " ".join(places), 'NumberOfComponents="3"') + "</Points><Polys>" + array("Int32", "connectivity", " ".join(str(places.index(c)) for c in corners))
            + array("Int32", "offsets", " ".join(str(3 * i + 3) for i in range(len(corners) // 3))) + "</Polys></Piece></PolyData></VTKFile>\n")


def test_every_kind_of_surface_is_measured_alike(bin, build, tmp_path):
    """Without --size: a fourteenth of the longest side, for every file type."""
    bar = meshlib.block(1)
    bar.points = [(x, 0.3 * y, 0.3 * z) for x, y, z in bar.points]
    text, counts = stl(bar), {}
    for name, write in (("a.stl", str), ("a.vtp", as_vtp), ("a.obj", as_obj), ("a.ply", as_ply)):
        if name in ("a.obj", "a.ply") and not (build / "lib/tensormass/image.so").exists():
            continue
        (tmp_path / name).write_text(write(text))
        said = subprocess.run([bin / "tm-mesh", "fill", "--unit", "mm", tmp_path / name, "-o", tmp_path / "a.msh"], capture_output=True, text=True)
        assert said.returncode == 0, name + said.stderr
        counts[name] = int(said.stdout.split(" tetrahedra")[0].split()[-1])
    assert len(counts) >= 2 and 300 < min(counts.values()) and max(counts.values()) < 1.03 * min(counts.values()), counts


@pytest.mark.parametrize("words,said", [
    (["nowhere.nii.gz"], "no such file"), (["{folder}"], "a folder; name a file"), (["{text}"], "neither an image"), (["{stl}"], "a surface file has no unit; add --unit mm"),
    (["{stl}", "--unit", "mm"], "open.stl"), (["{obj}", "--unit", "mm"], "open.obj"), (["{msh}"], "bad.msh"), (["{msh}", "--size", "3mm"], "this is a mesh already"), (["{msh}", "--budget", "9"], "--budget applies only to images"),
    (["{image}"], "seg.nii"), (["{big}"], "too large for an organ")])
def test_bad_input_leaves_nothing(bin, tmp_path, words, said):
    names = {"text": "notes.txt", "stl": "open.stl", "obj": "open.obj", "msh": "bad.msh", "image": "seg.nii", "big": "big.msh"}
    for name in names.values():
        (tmp_path / name).write_text("not much\n")
    (tmp_path / "big.msh").write_text(meshlib.msh2(meshlib.block(1, 100)))
    words = [w.format(folder=tmp_path, **{k: tmp_path / v for k, v in names.items()}) for w in words]
    assert said in organ(bin, *words, "-o", tmp_path / "out", "--no-video", code=2)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["brain", "vein"] if LONG else ["brain"])
def test_from_a_real_image_to_a_live_scene(even_bin, image_module, tmp_path, name):
    """Two labels that a budget cannot keep complete, or that need a thousand substeps: the result is a scene that half a processor core computes,
    without further options."""
    import phantom as image
    labels, extent, spacing = {"brain": (image.brain_at, (150, 185, 135), (5, 5, 5)), "vein": (image.vein_at, (140, 110, 90), (1, 1, 2.5))}[name]
    image.write(tmp_path / "seg.nii.gz", image.grid_of(labels, extent, np.array(spacing, float)), spacing)
    said = organ(even_bin, tmp_path / "seg.nii.gz", "-o", tmp_path / "out", "--no-video", *([] if LONG else ["--budget", "3000"]))
    told, took = live_figures(tmp_path / "out", said)
    assert took <= 0.5 and told == float(f"{took:.2g}") and "feel it: tm-session" in said, said
    if name == "brain":
        assert "warning: label 1 ('label_1') is in" in said


@pytest.mark.parametrize("name", ["--quiet.msh", "-d.msh", "--help.msh"])
def test_a_source_that_looks_like_an_option(bin, tmp_path, name):
    """The name is read as a file, and its error reported; no program mistakes it for an option."""
    (tmp_path / name).write_text("not much\n")
    out = subprocess.run([str(bin / "tm-organ"), "-o", "d", "--no-video", "--", name], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert out.returncode == 2 and f"{name}: does not begin with" in out.stderr and "option" not in out.stderr, out.stderr


@pytest.mark.parametrize("label", ["1=a\nb: 2", "1=a\x7f", "1=\x1b[31m"])
def test_control_characters_in_names_are_refused(bin, tmp_path, label):
    (tmp_path / "seg.nii").write_text("not much\n")
    said = organ(bin, tmp_path / "seg.nii", "--label", label, "-o", tmp_path / "out", code=2)
    assert "the name contains a control character" in said and label[2:] not in said
    said = subprocess.run([bin / "tm-mesh", "image", "--label", label, tmp_path / "seg.nii", "-o", tmp_path / "a.msh"], capture_output=True, text=True)
    assert said.returncode == 2 and "its name contains a control character" in said.stderr


def test_from_an_image(bin, image_module, tmp_path):
    import phantom as image
    image.write(tmp_path / "seg.nii.gz", image.phantom((5, 5, 5)), (5, 5, 5))
    names = [w for label in ("1=liver", "3=tumour", "4=ribs") for w in ("--label", label)]
    said = organ(bin, tmp_path / "seg.nii.gz", "-o", tmp_path / "out", "--video", "160x120", "--budget", "3500", *names)
    scene = (tmp_path / "out/organ.yaml").read_text()
    pressed_and_cut(tmp_path / "out")
    film_decodes(tmp_path / "out/organ.mp4")
    assert "3 regions" in said and "tetrahedra cut" in said and "over tumour" in scene and 'group: "ribs"' in scene


def two_labels(gap_mm, grid_mm=(3.0, 3.0, 3.0)):
    """A liver (1) and a gallbladder (2) beneath it, `gap_mm` apart; none: they share faces."""
    import phantom as image

    def at(p):
        out = np.zeros(p.shape[:-1], np.uint8)
        liver = image.ellipsoid(p, (0, 0, 12), (50, 36, 26))
        out[(image.ellipsoid(p, (8, -4, -28), (26, 14, 14)) < 0) & (liver > gap_mm)] = 2
        out[liver < 0] = 1
        return out
    return image.grid_of(at, (120, 90, 100), np.array(grid_mm))


def test_labels_with_a_gap_make_bodies_that_touch(bin, image_module, tmp_path):
    import phantom as image
    words = ["--label", "1=liver", "--label", "2=gallbladder", "--bodies", "-o", tmp_path / "out", "--no-film", "--budget", "2000"]
    image.write(tmp_path / "seg.nii.gz", two_labels(8), (3, 3, 3))
    organ(bin, tmp_path / "seg.nii.gz", *words)
    pressed_and_cut(tmp_path / "out")
    scene, whole = (tmp_path / "out/organ.yaml").read_text(), json.loads((tmp_path / "out/mesh.json").read_text())
    assert '"gallbladder.gallbladder": {young' in scene and "\ntouch:" in scene
    for body in whole["regions"]:
        subprocess.run([bin / "tm-mesh", "info", "--json", tmp_path / "one.json", tmp_path / f"out/{body['name']}.msh"], check=True, capture_output=True)
        one = json.loads((tmp_path / "one.json").read_text())
        assert [r["name"] for r in one["regions"]] == [body["name"]] and abs(one["volume_m3"] / body["volume_m3"] - 1) < 1e-9 and one["tets"] == body["tets"]
    explained = subprocess.run([bin / "tm-sim", tmp_path / "out/organ.yaml", "--explain"], check=True, capture_output=True, text=True).stdout
    assert "body liver:" in explained and "body gallbladder:" in explained and re.search(r"^touch ", explained, re.M)
    assert organ(bin, tmp_path / "seg.nii.gz", *words).count("(done before)") == 6
    (tmp_path / "out/tied.yaml").write_text(scene.replace("\n# ties:", "\nties:", 1))
    assert re.search(r"^ties: [1-9]", subprocess.run([bin / "tm-sim", tmp_path / "out/tied.yaml", "--explain"], check=True, capture_output=True, text=True).stdout, re.M)
    assert "#   touch:" not in scene


def test_a_gap_that_smoothing_closes_is_kept(bin, image_module, tmp_path):
    """Voxels of 5 mm along z, 8 mm apart: no two voxels of the labels meet, but their smoothed surfaces do, at any number of tetrahedra."""
    import phantom as image
    image.write(tmp_path / "seg.nii.gz", two_labels(8, (1.5, 1.5, 5)), (1.5, 1.5, 5))
    said = organ(bin, tmp_path / "seg.nii.gz", "--label", "1=liver", "--label", "2=gallbladder", "--bodies", "-o", tmp_path / "out", "--no-film", "--budget", "3000")
    assert re.search(r"smoothing closes the gap \(\d+ shared vertices\), so the voxels are not smoothed", said)
    assert (tmp_path / "out/gallbladder.msh").exists() and "\ntouch:" in (tmp_path / "out/organ.yaml").read_text()
    said = organ(bin, tmp_path / "seg.nii.gz", "--label", "1=liver", "--label", "2=liver", "-o", tmp_path / "same", "--no-film", code=2)
    assert "--label 2=liver: label 1 has this name; give each its own" in said and not (tmp_path / "same").exists()


def test_labels_that_share_faces_make_no_bodies(bin, image_module, tmp_path):
    import phantom as image
    image.write(tmp_path / "seg.nii.gz", two_labels(0), (3, 3, 3))
    words = ["--bodies", "-o", tmp_path / "out", "--no-film", "--budget", "2000"]
    said = organ(bin, tmp_path / "seg.nii.gz", "--label", "1=liver", "--label", "2=gallbladder", *words, code=2)
    assert re.search(r"--bodies: regions share \d+ vertices, and so hold each other; raise --budget", said)
    assert "--bodies needs two regions" in organ(bin, tmp_path / "seg.nii.gz", "--label", "1=liver", *words, code=2)
    assert "is no name for a body" in organ(bin, tmp_path / "seg.nii.gz", "--label", "1=a liver", "--label", "2=gallbladder", *words, code=2)
    assert not (tmp_path / "out").exists()
