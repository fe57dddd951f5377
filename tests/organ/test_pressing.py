"""Random pressing on a mesh that tm-mesh image made: no verdict of `make stability`'s kind against it. An hour in the long form."""
import subprocess
import sys

import pytest

sys.path[:0] = ["tests/mesh", "tests/organ"]
import pressing  # noqa: E402


def made(bin, build, folder, budget):
    if not (build / "lib/tensormass/image.so").exists():
        pytest.skip("no module 'image': make image builds it (ITK, CGAL)")
    import phantom
    phantom.write(folder / "seg.nii.gz", phantom.phantom((5, 5, 5)), (5, 5, 5))
    for words in (["tm-mesh", "image", folder / "seg.nii.gz", "--budget", budget, "--label", "1=liver", "--label", "3=tumour", "--label", "4=ribs", "-o", folder / "organ.msh"],
                  ["tm-scene", "new", "--up", "-y", folder / "organ.msh"]):
        subprocess.run([bin / words[0], *words[1:]], check=True, capture_output=True, timeout=120)
    return folder / "organ.yaml"


def test_random_pressing(bin, build, tmp_path):
    said = pressing.press(bin, made(bin, build, tmp_path, "2500"), 1, 15, tmp_path)
    assert said["verdict"] == "stable" and said["waypoints"] > 12, said


@pytest.mark.parametrize("seed", range(1, 7))
@pytest.mark.long
def test_an_hour_of_random_pressing(bin, build, once, tmp_path, seed):
    scene = once("pressed-organ", lambda folder: made(bin, build, folder, "3000")) / "organ.yaml"
    said = pressing.press(bin, scene, seed, 600, tmp_path)
    print(said)
    assert said["verdict"] == "stable" and said["waypoints"] > 500, said
