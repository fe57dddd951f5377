"""tm-organ: a phantom goes from an image, a surface or tetrahedra to a press and a cut that are felt and filmed; what is done stays done; bad input leaves nothing."""
import json
import subprocess
import sys

import numpy as np
import pytest

sys.path[:0] = ["tests/mesh", "tests/scene"]
import meshlib  # noqa: E402
from test_scene import phantom  # noqa: E402

MADE = {"organ.msh", "organ.yaml", "press.lcm", "force.csv", "organ.png", "press.json", "rest.json", "rest.vtk", "mesh.json", "check.txt", ".organ.done"}


def organ(bin, *words, code=0):
    out = subprocess.run([str(bin / "tm-organ"), *map(str, words)], capture_output=True, text=True, timeout=400)
    assert out.returncode == code, out.stdout + out.stderr
    return out.stdout + out.stderr


def stl(mesh):
    """The block's outer triangles, in text and millimetres."""
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
    said = organ(bin, folder / "phantom.msh", "-o", folder / "felt", "--film", "160x120")
    return folder, said


def pressed_and_cut(folder):
    """Tetrahedra went, and what the hands felt was recorded: a row a tick of 500 Hz, both hands, never above the device's limit."""
    figures = json.loads((folder / "press.json").read_text())
    assert figures["tets_removed"] > 3 and figures["tets_alive"] + figures["tets_removed"] == figures["tets"]
    rows = np.genfromtxt(folder / "force.csv", delimiter=",", names=True)
    force = np.sqrt(rows["fx_N"] ** 2 + rows["fy_N"] ** 2 + rows["fz_N"] ** 2)
    assert len(rows) > 2 * 500 * 6.3 and not rows["fault"].any()
    for hand, begin, end in ((0, 0.6, 4.4), (1, 3.2, 6)):
        mine, t = force[rows["instrument"] == hand], rows["time_s"][rows["instrument"] == hand]
        assert 0.05 < mine[(t > begin) & (t < end)].max() == mine.max() < 8.9, hand
        assert mine[t > 6.2].max() == 0  # both have gone
    return figures


def film_decodes(path):
    """All of its pictures; the brightness of each, red."""
    raw = subprocess.run(["ffmpeg", "-v", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, timeout=120)
    assert raw.returncode == 0 and not raw.stderr, raw.stderr
    pictures = np.frombuffer(raw.stdout, "u1").reshape(-1, 120, 160, 3).astype(float)
    assert len(pictures) == 160
    organ = np.abs(pictures[:, 45:90, 40:120] - pictures[0, 45:90, 40:120]).mean((1, 2, 3))
    assert organ[60:80].max() > 0.5 and organ[-1] > 0.5  # instruments came, and something is not as it was


def test_from_a_mesh_to_a_film(felt):
    folder, said = felt
    assert {p.name for p in (folder / "felt").iterdir()} == MADE | {"organ.mp4"}
    assert (folder / "felt/organ.png").read_bytes()[:4] == b"\x89PNG"
    cut = pressed_and_cut(folder / "felt")["tets_removed"]
    film_decodes(folder / "felt/organ.mp4")
    assert f"{cut} tetrahedra cut" in said and "6/6 film" in said and "done before" not in said


def test_what_is_done_stays_done_and_an_edited_scene_is_yours(bin, felt):
    folder, _ = felt
    again = ["-o", folder / "felt", "--no-film"]
    assert organ(bin, folder / "phantom.msh", *again).count("(done before)") == 5
    scene = folder / "felt/organ.yaml"
    scene.write_text(scene.read_text().replace("young: 5.5 kPa", "young: 7 kPa"))
    said = organ(bin, folder / "phantom.msh", *again)
    assert said.count("(done before)") == 1 and "yours, kept" in said and "young: 7 kPa" in scene.read_text()
    (folder / "felt/force.csv").unlink()
    said = organ(bin, folder / "phantom.msh", *again)
    assert said.count("(done before)") == 4 and (folder / "felt/force.csv").exists()


def test_from_a_surface(bin, tmp_path):
    (tmp_path / "liver.stl").write_text(stl(meshlib.block(1)))
    said = organ(bin, tmp_path / "liver.stl", "--unit", "mm", "--size", "25mm", "-o", tmp_path / "out", "--no-film", "--no-cut")
    assert {p.name for p in (tmp_path / "out").iterdir()} == MADE
    assert "Roulot" in (tmp_path / "out/organ.yaml").read_text() and "peak" in said  # a tissue by the file's name


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
    """Without --size: a fourteenth of the longest side, of whatever file it is in."""
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
    (["nowhere.nii.gz"], "no such file"), (["{folder}"], "a folder; name a file"), (["{text}"], "neither an image"), (["{stl}"], "does not say its unit; add --unit mm"),
    (["{stl}", "--unit", "mm"], "open.stl"), (["{obj}", "--unit", "mm"], "open.obj"), (["{msh}"], "bad.msh"), (["{msh}", "--size", "3mm"], "tetrahedra already"), (["{msh}", "--budget", "9"], "--budget is for images"),
    (["{image}"], "seg.nii"), (["{big}"], "too large for an organ")])
def test_bad_input_leaves_nothing(bin, tmp_path, words, said):
    names = {"text": "notes.txt", "stl": "open.stl", "obj": "open.obj", "msh": "bad.msh", "image": "seg.nii", "big": "big.msh"}
    for name in names.values():
        (tmp_path / name).write_text("not much\n")
    (tmp_path / "big.msh").write_text(meshlib.msh2(meshlib.block(1, 100)))
    words = [w.format(folder=tmp_path, **{k: tmp_path / v for k, v in names.items()}) for w in words]
    assert said in organ(bin, *words, "-o", tmp_path / "out", "--no-film", code=2)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["--quiet.msh", "-d.msh", "--help.msh"])
def test_a_source_that_looks_like_an_option(bin, tmp_path, name):
    """It is read, and what is wrong with it told; no program takes it for an option."""
    (tmp_path / name).write_text("not much\n")
    out = subprocess.run([str(bin / "tm-organ"), "-o", "d", "--no-film", "--", name], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert out.returncode == 2 and f"{name}: does not begin with" in out.stderr and "option" not in out.stderr, out.stderr


@pytest.mark.parametrize("label", ["1=a\nb: 2", "1=a\x7f", "1=\x1b[31m"])
def test_control_characters_in_names_are_refused(bin, tmp_path, label):
    (tmp_path / "seg.nii").write_text("not much\n")
    said = organ(bin, tmp_path / "seg.nii", "--label", label, "-o", tmp_path / "out", code=2)
    assert "a control character in a name" in said and label[2:] not in said
    said = subprocess.run([bin / "tm-mesh", "image", "--label", label, tmp_path / "seg.nii", "-o", tmp_path / "a.msh"], capture_output=True, text=True)
    assert said.returncode == 2 and "a control character in its name" in said.stderr


def test_from_an_image(bin, build, tmp_path):
    if not (build / "lib/tensormass/image.so").exists():
        pytest.skip("no module 'image': make image builds it (ITK, CGAL)")
    import phantom as image
    image.write(tmp_path / "seg.nii.gz", image.phantom((5, 5, 5)), (5, 5, 5))
    names = [w for label in ("1=liver", "3=tumour", "4=ribs") for w in ("--label", label)]
    said = organ(bin, tmp_path / "seg.nii.gz", "-o", tmp_path / "out", "--film", "160x120", "--budget", "3500", *names)
    scene = (tmp_path / "out/organ.yaml").read_text()
    pressed_and_cut(tmp_path / "out")
    film_decodes(tmp_path / "out/organ.mp4")
    assert "3 regions" in said and "tetrahedra cut" in said and "over tumour" in scene and 'group: "ribs"' in scene
