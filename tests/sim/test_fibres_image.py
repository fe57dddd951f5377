"""Fibres from a NIfTI image of directions, compared with the rule that made it, on a mirrored and rotated grid, in each convention of axes."""
import sys

import numpy as np
import pytest

sys.path[:0] = ["tests/mesh", "tests/sim"]
import phantom  # noqa: E402
from test_fibres import CIRCULAR, arc, meshlib, run  # noqa: E402

FLIPPED = np.array([[0, -1.0, 0], [-1, 0, 0], [0, 0, -1]])  # a mirrored grid with permuted axes
SPACING, SIZE = np.array([4.0, 5, 6]), (29, 24, 8)


@pytest.fixture(scope="module")
def folder(image_module, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fibres")
    (folder / "arc.msh").write_text(meshlib.msh2(arc()))
    return folder


def write(path, axes="image", five=False, change=lambda v: v, header=lambda h: None):
    """Directions around an axis in LPS, with either sign and any length."""
    grid = np.stack(np.meshgrid(*map(np.arange, SIZE), indexing="ij"), -1)
    origin = np.array([108.0, 112, 35])
    place = origin + (grid * SPACING) @ FLIPPED.T
    round_it = np.stack([-place[..., 1], place[..., 0], 0 * place[..., 0]], -1)
    round_it /= np.linalg.norm(round_it, axis=-1, keepdims=True)
    dice = np.random.default_rng(1)
    round_it *= dice.choice([-1.2, 0.8], place.shape[:-1])[..., None]
    round_it = change({"image": round_it @ FLIPPED, "lps": round_it, "ras": round_it * (-1, -1, 1)}[axes]).astype("f4")
    return phantom.write(path, round_it[:, :, :, None, :] if five else round_it, SPACING, origin=origin, direction=FLIPPED, change=lambda h: (five and h.__setitem__(slice(68, 70), b"\xef\x03"), header(h)))  # NIFTI_INTENT_VECTOR


@pytest.mark.parametrize("axes,name,five", [("image", "v.nii.gz", False), ("image", "v.nii", True), ("lps", "v.nii", True), ("ras", "v.nii.gz", False)])
def test_fibres_from_an_image_follow_the_rule(bin, folder, axes, name, five):
    write(folder / name, axes, five)
    rule = run(bin, folder, CIRCULAR)
    assert run(bin, folder, f"file: {name}, axes: {axes}") == pytest.approx(rule, rel=0.01)
    other = {"image": "lps", "lps": "image", "ras": "image"}[axes]
    assert abs(run(bin, folder, f"file: {name}, axes: {other}") / rule - 1) > 0.05  # the check can fail


def half(vectors):
    vectors[:, :12] = 0
    return vectors


def lies(header):
    header[42:48] = b"\0\x04\0\x04\0\x03"


@pytest.mark.parametrize("said,words,make", [
    ("give axes: image, lps or ras", "file: v.nii", write), ("leave them out", "rule: constant, axes: lps", write), ("no vector at", "file: v.nii, axes: lps", lambda p: write(p, change=half)),
    ("so it is truncated or damaged", "file: v.nii, axes: lps", lambda p: write(p, header=lies)), ("of 1 number a voxel", "file: v.nii, axes: lps", lambda p: phantom.write(p, np.zeros((9, 9, 9), "f4"), SPACING)),
    ("not float32", "file: v.nii, axes: lps", lambda p: phantom.write(p, np.zeros((9, 9, 9, 3), "i2"), SPACING)), ("no vector at", "file: v.nii, axes: lps", lambda p: write(p, change=lambda v: v * np.nan)), ("no finite vector", "file: v.nii, axes: lps", lambda p: write(p, change=lambda v: v * 1e20)),
    ("ends within its header", "file: v.nii, axes: lps", lambda p: p.write_text("nothing")), ("no such file", "file: w.nii, axes: lps", write)])
def test_bad_images(bin, folder, said, words, make):
    make(folder / "v.nii")
    error = run(bin, folder, words, code=2)
    assert said.lower() in error.lower() and error.startswith(str(folder / "arc.yaml") + ":") and error.count("\n") == 1, error
