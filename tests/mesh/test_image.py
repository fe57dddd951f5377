"""tm-mesh image: from a segmented image to tetrahedra. The phantom is phantom.py's."""
import json
import re
import signal
import struct
import subprocess
import time

import dicom_seg
import numpy as np
import phantom
import pytest

pytestmark = pytest.mark.usefixtures("image_module")


@pytest.fixture(scope="module")
def run(bin):
    def run(image, *options, out=None, **kwargs):
        out = out or image.with_suffix(".msh")
        return subprocess.run([bin / "tm-mesh", "image", image, "-o", out, *options], capture_output=True, text=True, timeout=800, **kwargs)
    return run


# One rounded box in another: 14 x 12 x 10 voxels, cheap.
def small(kind="u1"):
    image = np.zeros((16, 14, 12), kind)
    image[2:14, 2:12, 2:10] = 1
    image[5:9, 4:8, 4:8] = 2
    image[2:4, 2:4, 2:4] = 0  # no symmetry, so that a flip is detected
    return image


FAST = ("--size", "8mm", "--optimise", "exude")


def places(path):
    lines = path.read_text().split("$Nodes\n")[1].split("$EndNodes")[0].splitlines()
    return np.array([[float(x) for x in line.split()[1:]] for line in lines[1:]])


def middle(vertices):
    return (vertices.min(0) + vertices.max(0)) / 2


def test_a_phantom_becomes_regions(tmp_path, run):
    image = phantom.phantom((4, 4, 4), noise=0.002)
    path = phantom.write(tmp_path / "phantom.nrrd", image, (4, 4, 4), origin=(10, 20, 30))
    done = run(path, "--budget", "3000", "--label", "1=liver", "--label", "3", "--smooth", "0.8", "--json", tmp_path / "report.json")
    assert done.returncode == 0, done.stderr
    assert "specks and holes" in done.stderr
    report = json.loads((tmp_path / "report.json").read_text())
    assert 0.8 * 3000 < report["tets"] <= 3000
    assert [r["name"] for r in report["regions"]] == ["liver", "tumour"]  # the second label's name comes from the file
    liver = report["regions"][0]
    count = (image == 1).sum() * 64e-9
    assert abs(liver["image_volume_m3"] / count - 1) < 0.02 and abs(liver["volume_m3"] / liver["image_volume_m3"] - 1) < 0.02
    assert 0 < liver["mean_distance_m"] < 2e-3 < liver["hausdorff_m"] < 20e-3
    assert report["smallest_dihedral_deg"] > 5 and 1 <= report["critical_step"]["cut_tet"] <= report["tets"]
    assert re.search(r"critical step: .* set by tetrahedron \d+ \(vertices [\d ]+\) in '(liver|tumour)'", done.stdout)


def volumes_off(json_file):
    return {r["label"]: r["volume_m3"] / r["image_volume_m3"] - 1 for r in json.loads(json_file.read_text())["regions"]}


@pytest.mark.parametrize("spacing, options", [((4, 4, 5), ("--budget", "2500")), ((4, 4, 5), ("--budget", "3500", "--smooth", "1")), ((6, 6, 6), ("--budget", "3500"))])
def test_labels_have_their_volumes(tmp_path, run, spacing, options):
    """At any coarse budget labels keep their volume; without correction, chords and smoothing take 13 to 38 % of thin labels."""
    path, report = phantom.write(tmp_path / "a.nrrd", phantom.phantom(spacing), spacing), tmp_path / "a.json"
    done = run(path, *options, "--json", report, "--allow", "vanish")
    off = volumes_off(report)
    assert len(off) == 4 and max(map(abs, off.values())) < 1e-4, off
    assert "than in the image" not in done.stderr and json.loads(report.read_text())["smallest_dihedral_deg"] > 5


def proposed(done):
    """Returns the option that the program proposes as a remedy, which it has tried."""
    found = re.search(r"all labels are kept with (--.*) \(tried: (\d+) tetrahedra\)", done.stderr)
    return found and (found[1].split(), int(found[2]))


def test_lost_volume_is_reported_with_a_remedy(tmp_path, run):
    path, report = phantom.write(tmp_path / "a.nrrd", phantom.phantom((4, 4, 5)), (4, 4, 5)), tmp_path / "a.json"
    words = ("--budget", "3500", "--json", report)
    done = run(path, *words, "--optimise", "exude,improve")
    off = volumes_off(report)
    assert off[2] < -0.1 and off[3] < -0.1 and abs(off[1]) < 0.02, off
    told = re.findall(r"warning: label (\d) \('(\w+)'\) has (\d+) % less volume than in the image, because --optimise leaves out volumes", done.stderr)
    assert [(label, name) for label, name, _ in told] == [("2", "vessels"), ("3", "tumour")] and int(told[0][2]) == round(-100 * off[2])
    done = run(path, *words, "--smooth", "1")  # a vessel's end is missing, and the remainder has its volume
    told = re.findall(r"warning: the surface of label (\d) \('(\w+)'\) is up to ([\d.]+) mm from the image's", done.stderr)
    assert ("2", "vessels") in [(label, name) for label, name, _ in told] and float(told[-1][2]) > 15, done.stderr
    repairs, tets = proposed(done)
    assert repairs[0] == "--smooth", repairs
    done = run(path, *words, *repairs)
    assert "warning:" not in done.stderr and json.loads(report.read_text())["tets"] == tets, done.stderr


def test_a_folded_sheet_ends_with_a_mesh_and_a_proposal_that_works(tmp_path, run):
    """A brain of grey and white matter: the grey matter tears at this budget, which is reported with figures; the proposed option was tried and
    works."""
    spacing = np.array([4.0, 4.0, 4.0])
    path, report = phantom.write(tmp_path / "a.nii.gz", phantom.grid_of(phantom.brain_at, (150, 185, 135), spacing), spacing), tmp_path / "a.json"
    done = run(path, "--json", report)
    assert done.returncode == 0, done.stderr
    told = re.search(r"warning: label 1 \('label_1'\) is in (\d+) pieces, in the image in 1; the largest has ([\d.]+) %", done.stderr)
    assert told and int(told[1]) > 5 and float(told[2]) > 80, done.stderr
    assert max(map(abs, volumes_off(report).values())) < 0.01 and "loose" in done.stderr or json.loads(report.read_text())["tets"] <= 10000
    repairs, tets = proposed(done)
    again = run(path, *repairs, "--json", report)
    assert again.returncode == 0 and "warning:" not in again.stderr and json.loads(report.read_text())["tets"] == tets, again.stderr


def test_a_size_of_its_own_beyond_the_budget_is_told_at_once(tmp_path, run):
    path = phantom.write(tmp_path / "a.nrrd", small(), (4, 4, 4))
    done = run(path, "--budget", "300", "--label", "all", "--label", "2:3mm", out=tmp_path / "out.msh")
    assert done.returncode == 2 and re.search(r"labels with their own size need \d+ tetrahedra, all labels \d+, more than --budget 300", done.stderr), done.stderr
    done = run(path, "--budget", "120", out=tmp_path / "out.msh")  # the complete mesh is coarsened as far as possible
    assert done.returncode == 0, done.stderr


def corners_off(image, spacing, msh):
    """Returns {label: distance of its surface's worst vertex from its voxels' faces, mm}; the image's first voxel is at 0."""
    vertices = places(msh) * 1e3
    rows = [line.split() for line in msh.read_text().split("$Elements\n")[1].split("$EndElements")[0].splitlines()[1:]]
    tets = np.array([[int(x) for x in (row[3], *row[-4:])] for row in rows if row[1] == "4"])
    off = {}
    for label, region in zip(np.unique(image)[1:], np.unique(tets[:, 0])):
        corner = tets[tets[:, 0] == region, 1:] - 1
        faces = np.sort(np.concatenate([np.delete(corner, k, 1) for k in range(4)]), 1)
        once, count = np.unique(faces, axis=0, return_counts=True)
        at, padded = [], np.pad(image == label, 1)
        for axis in range(3):
            middle = np.argwhere(np.diff(padded.astype("i1"), axis=axis)) - 1.0
            middle[:, axis] += 0.5
            at.append(middle * spacing)
        at = np.concatenate(at)
        off[int(label)] = max(np.sqrt(((at - vertices[v]) ** 2).sum(1).min()) for v in np.unique(once[count == 1]))
    return off


def test_surfaces_have_no_spikes(tmp_path, run):
    """No vertex of a label's surface is far from it: 18 mm on the liver and 23 mm on the ribs when vertices once slid round thin labels."""
    spacing = (4, 4, 5)
    image = phantom.phantom(spacing)
    path = phantom.write(tmp_path / "a.nrrd", image, spacing)
    run(path, "--budget", "3500")
    off = corners_off(image, spacing, path.with_suffix(".msh"))
    assert len(off) == 4 and max(off.values()) < 8, off


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd", "a.mha", "a.mhd"])
def test_every_format_gives_the_same_position(tmp_path, run, name, bin):
    turn = np.array([[0, -1, 0], [-1, 0, 0], [0, 0, 1.0]])  # a mirrored grid
    path = phantom.write(tmp_path / name, small(), (2, 3, 4), origin=(10, -20, 30), direction=turn)
    done = run(path, *FAST)
    assert done.returncode == 0, done.stderr
    vertices = places(path.with_suffix(".msh"))
    expected = np.array([10, -20, 30]) + turn @ ((np.array([7.5, 6.5, 5.5])) * (2, 3, 4))
    assert np.abs(middle(vertices) * 1e3 - expected).max() < 1.0
    extent = (vertices.max(0) - vertices.min(0)) * 1e3
    assert np.abs(extent - np.array([30, 24, 32])).max() < 3.5
    assert subprocess.run([bin / "tm-mesh", "check", path.with_suffix(".msh")], capture_output=True).returncode == 0


def test_units_axes_and_repeatability(tmp_path, run):
    middles = {}
    for unit, factor in (("mm", 1), ("m", 1e-3), ("um", 1e3), ("", 1)):
        path = phantom.write(tmp_path / f"u{unit}.nrrd", small("i2"), np.array([2, 2, 2.0]) * factor, origin=np.array([40, 50, 60.0]) * factor, unit=unit)
        done = run(path, *FAST)
        assert done.returncode == 0, done.stderr
        assert ("no unit of length" in done.stderr) == (unit == "")
        middles[unit] = middle(places(path.with_suffix(".msh")))
        assert np.abs(middles[unit] - middles["mm"]).max() < 1e-6, unit
    again, ras = tmp_path / "again.msh", tmp_path / "ras.msh"
    run(tmp_path / "umm.nrrd", *FAST, out=again)
    assert again.read_bytes() == (tmp_path / "umm.msh").read_bytes()
    run(tmp_path / "umm.nrrd", *FAST, "--space", "ras", out=ras)
    assert np.abs(middle(places(ras)) * (-1, -1, 1) - middles["mm"]).max() < 1e-9


def test_budget_realtime_fits_this_machine(tmp_path, run):
    """A tenth of the processor share gives fewer tetrahedra; the measured share is reported together with the requested one (their difference depends
    on the machine)."""
    path, tets = phantom.write(tmp_path / "a.nrrd", small(), (4, 4, 4)), {}
    for share in (0.2, 0.02):
        done = run(path, "--budget", f"realtime:{share}", "--optimise", "exude", "--json", tmp_path / "a.json")
        assert done.returncode == 0, done.stderr
        report = json.loads((tmp_path / "a.json").read_text())
        tets[share] = report["tets"]
        assert report["load"] > 0 and f"{share:.2f} requested" in done.stdout, report
    assert tets[0.2] > tets[0.02]


def cut_short(path):
    data = path.read_bytes()
    path.write_bytes(data[:len(data) * 2 // 3])


def header_lies(header):
    struct.pack_into("<8h", header, 40, 3, 1000, 1000, 1000, 1, 1, 1, 1)


def header_lies_2_gb(header):
    struct.pack_into("<8h", header, 40, 3, 1024, 1024, 1023, 1, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 512, 16)


DICOM = {"dicom of a scanner": (dict(modality="CT"), "its modality is 'CT'"), "dicom fractional": (dict(kind="FRACTIONAL"), "not BINARY or LABELMAP"), "dicom cut": (dict(change=lambda d: d[:-200]), "ends within its voxels"),
         "dicom one frame": (dict(change=lambda d: d.replace(b"\x28\x00\x08\x00IS\x02\x0012", b"\x28\x00\x08\x00IS\x02\x0099")), "frames are described"), "dicom lies": (dict(change=lambda d: d.replace(b"\x28\x00\x10\x00US\x02\x00\x0e\x00", b"\x28\x00\x10\x00US\x02\x00\xff\x7f")), "its header says")}


def bad(folder, name):
    """A bad image and a word of its error message."""
    image, spacing = small(), (2, 2, 2)
    rough = np.random.default_rng(1).integers(0, 3, (30, 30, 30)).astype("u1")
    if name == "empty":
        return phantom.write(folder / "empty.nrrd", 0 * image, spacing), "no voxel has a label"
    if name == "one slice":
        return phantom.write(folder / "slice.mha", image[:, :, 5:6], spacing), "one voxel thick"
    if name == "4-D":
        return phantom.write(folder / "four.nii", np.stack([image, image], -1), spacing), "4 dimensions"
    if name == "float":
        return phantom.write(folder / "float.nii.gz", image.astype("f4"), spacing), "float, not labels"
    if name == "negative":
        return phantom.write(folder / "negative.nii", image.astype("i2") - 1, spacing), "label -1"
    if name in ("cut.nii.gz", "cut.nrrd", "cut.mha", "cut.nii"):
        path = phantom.write(folder / name, rough, spacing)
        cut_short(path)
        return path, "damaged"
    if name == "header lies":
        return phantom.write(folder / "lie.nii.gz", image, spacing, change=header_lies), "so it is truncated or damaged"
    if name == "header lies by 2 GB":
        return phantom.write(folder / "lie.nii", image.astype("u2"), spacing, change=header_lies_2_gb), "its header says 2.15e+03 MB of voxels"
    if name == "2-D":
        return phantom.write(folder / "flat.nii", image[:, :, 5], (2, 2, 2)), "2 dimensions; give a volume of three"
    if name == "dicom":
        (folder / "a.dcm").write_bytes(b"\0" * 128 + b"DICM")
        return folder / "a.dcm", "not a segmentation|GDCM cannot read it"
    if name in DICOM:
        words, said = DICOM[name]
        dicom_seg.write_dicom_seg(folder / "a.dcm", image, spacing, **words)
        return folder / "a.dcm", said
    (folder / "a.nii").write_text("nothing")
    return folder / "a.nii", "it ends within its header|unknown type of image"


@pytest.mark.parametrize("name", ["empty", "one slice", "4-D", "float", "negative", "cut.nii.gz", "cut.nrrd", "cut.mha", "cut.nii", "header lies", "header lies by 2 GB", "2-D", "dicom", *DICOM,
                                  "nothing"])
def test_bad_images(tmp_path, run, name):
    path, word = bad(tmp_path, name)
    out = tmp_path / "out.msh"
    done = run(path, *FAST, out=out)
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    assert any(w in done.stderr for w in word.split("|")) and done.stderr.startswith(str(path)) and done.stderr.count("\n") == 1, done.stderr
    assert not out.exists()


def test_labels_that_are_not_there_vanish_or_fall_apart(tmp_path, run):
    image = small()
    image[11:13, 9:11, 7:9] = 4  # 8 voxels, 4 mm wide
    path = phantom.write(tmp_path / "a.nrrd", image, (2, 2, 2))
    out = tmp_path / "out.msh"
    done = run(path, *FAST, "--label", "1", "--label", "9=kidney", out=out)
    assert done.returncode == 2 and "label 9 ('kidney') is empty" in done.stderr
    coarse = ("--size", "30mm", "--label", "1:30mm", "--label", "4=node:30mm", "--smooth", "2", "--optimise", "none")
    done = run(path, *coarse, "--strict", out=out)
    assert done.returncode == 2 and "label 4 ('node') vanished: 0.064 cm3 in the image; mesh it finer, smooth less, or leave out --strict" in done.stderr, done.stderr
    assert not out.exists()
    done = run(path, *coarse, "--strict", "--allow", "vanish", out=out)
    assert done.returncode == 0 and "label 4 ('node') vanished" in done.stderr
    done = run(path, *coarse, out=out)
    assert done.returncode == 0 and "warning: label 4 ('node') vanished: 0.064 cm3 in the image" in done.stderr
    assert "node" not in out.read_text(), "a region without tetrahedra"


def test_remedy_in_the_message_restores_a_lost_label(tmp_path, run):
    """No label was named: following the message keeps the others."""
    image = small()
    image[11:13, 9:11, 7:9] = 4
    path, out, report = phantom.write(tmp_path / "a.nrrd", image, (2, 2, 2)), tmp_path / "out.msh", tmp_path / "report.json"
    labels = sorted(set(image.ravel().tolist()) - {0})
    words = ("--size", "30mm", "--optimise", "volumes", "--smooth", "1", "--json", report)
    done = run(path, *words, "--label", "all", "--label", "4:30mm", out=out)
    assert done.returncode == 0 and "label 4 ('ribs') vanished" in done.stderr and len(labels) > 1, done.stderr
    repairs, _ = proposed(done)
    done = run(path, *[w for w in words if w not in ("--smooth", "1")] if "--smooth" in repairs else words, *repairs, out=out)
    assert done.returncode == 0 and "warning:" not in done.stderr, done.stderr
    assert sorted(r["label"] for r in json.loads(report.read_text())["regions"]) == labels
    done = run(path, "--size", "30mm", "--label", "all", "--label", "9:3mm", out=out)
    assert done.returncode == 2 and "label 9 is not in the image" in done.stderr


def test_a_label_one_voxel_thick(tmp_path, run):
    image = small()
    image[10, 4:8, 4:8] = 3
    path = phantom.write(tmp_path / "thin.mha", image, (2, 2, 2))
    done = run(path, *FAST, "--strict", out=tmp_path / "strict.msh")
    assert done.returncode == 2 and "label 3 ('label_3') is one voxel thick" in done.stderr and not (tmp_path / "strict.msh").exists()
    done = run(path, *FAST)
    assert done.returncode == 0 and "warning: label 3 ('label_3') is one voxel thick" in done.stderr, done.stderr


@pytest.mark.parametrize("options, word", [(("--budget", "5"), "100 to 5000000"), (("--label", "0"), "1 to 65535"), (("--optimise", "polish"), "not one of its values"),
                                           (("--size", "5mm", "--budget", "3000"), "give one"), (("--space", "up"), "lps or ras"), (("--smooth", "-1"), "0 to 5")])
def test_bad_usage(tmp_path, run, options, word):
    done = run(tmp_path / "a.nii", *options)
    assert done.returncode == 2 and word in done.stderr


def test_a_signal_ends_it_and_nothing_is_written(tmp_path, bin):
    path = phantom.write(tmp_path / "a.nrrd", small(), (2, 2, 2))
    out = tmp_path / "out.msh"
    process = subprocess.Popen([bin / "tm-mesh", "image", path, "-o", out, "--size", "0.4mm"], stderr=subprocess.PIPE)
    time.sleep(1.5)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=120)
    assert process.returncode == 130 and not out.exists() and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("kind", ["BINARY", "LABELMAP"])
def test_dicom_seg_gives_what_nrrd_gives(tmp_path, run, kind):
    """Segments in frames, empty slices omitted, a rotated grid: the same places, labels and names."""
    turn, place = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]), dict(origin=(10, -20, 30))
    plain = phantom.write(tmp_path / "a.nrrd", small(), (2, 3, 4), direction=turn, **place)
    dicom_seg.write_dicom_seg(tmp_path / "a.dcm", small(), (2, 3, 4), direction=turn, names={1: "liver", 2: "vessels"}, kind=kind, **place)
    told = []
    for path in (plain, tmp_path / "a.dcm"):
        done = run(path, *FAST, "--json", path.with_suffix(".json"))
        assert done.returncode == 0, done.stderr
        told.append((json.loads(path.with_suffix(".json").read_text())["regions"], middle(places(path.with_suffix(".msh")))))
        path.with_suffix(".msh").unlink()
    assert [r["name"] for r in told[1][0]] == ["liver", "vessels"] and np.abs(told[0][1] - told[1][1]).max() < 2e-4
    assert [round(r["image_volume_m3"] * 1e12) for r in told[0][0]] == [round(r["image_volume_m3"] * 1e12) for r in told[1][0]]


@pytest.mark.long
def test_a_real_image(tmp_path, run):
    """Three nuclei of a brain, from the labels in Debian's mricron-data (AAL, 1 mm): correct volumes, one component each, in place."""
    got = subprocess.run(["apt-get", "download", "-q", "mricron-data"], cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert got.returncode == 0, got.stderr
    subprocess.run(["dpkg-deb", "-x", next(tmp_path.glob("mricron-data_*.deb")), tmp_path / "x"], check=True)
    out, report = tmp_path / "nuclei.msh", tmp_path / "nuclei.json"
    done = run(tmp_path / "x/usr/share/mricron/templates/aal.nii.gz", "--label", "71=caudate_left", "--label", "73=putamen_left", "--label", "77=thalamus_left", "--budget", "6000",
               "--json", report, out=out)
    assert done.returncode == 0 and "181 x 217 x 181 voxels of 1 x 1 x 1 mm" in done.stdout, done.stdout + done.stderr
    off = volumes_off(report)
    assert set(off) == {71, 73, 77} and max(map(abs, off.values())) < 0.02, off
    assert 5000 < json.loads(report.read_text())["tets"] <= 6100
    assert -0.001 < places(out)[:, 0].min() < places(out)[:, 0].max() < 0.04, "left is +x in LPS"
