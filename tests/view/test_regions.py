"""Regions of a mesh in pictures: colours, transparency, section planes, up direction."""
import json
import subprocess
import sys

import pytest

sys.path[:0] = ["tests/mesh", "tests/view"]
import meshlib  # noqa: E402
from test_view import pixels, run, share  # noqa: E402

FLAT = ("--size", "200x160", "--quality", "0", "--no-words")


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    """Makes a block of liver, 10 cm, with a cube of vein (blue) in its middle."""
    m, path = meshlib.block(5), tmp_path_factory.mktemp("regions") / "block.msh"
    m.names = {(3, 1): "liver", (3, 2): "vein"}
    m.region = [2 if all(0.039 < m.points[v][a] < 0.061 for v in t for a in range(3)) else 1 for t in m.tets]
    assert m.region.count(2) == 6
    path.write_text(meshlib.msh2(m))
    return path


def blue(r, g, b):
    return (b > 0.2) & (b > 1.5 * r) & (b > 1.5 * g)


def red(r, g, b):
    return (r > 0.2) & (r > 1.6 * g) & (r > 1.6 * b)


def draw(bin, mesh, *more):
    out, figures = mesh.with_suffix(".png"), mesh.with_suffix(".json")
    done = run(bin, mesh, "--png", out, "--json", figures, *FLAT, *more)
    assert done.returncode == 0, done.stderr
    picture = pixels(out)
    return share(picture, blue), share(picture, red), json.loads(figures.read_text())["triangles"]


def test_inner_regions_show_through_or_in_section(bin, mesh):
    whole, through, open_ = draw(bin, mesh), draw(bin, mesh, "--through", "0.8"), draw(bin, mesh, "--clip", "0,0,1")
    assert whole[0] == 0 and whole[1] > 0.05
    assert through[0] > 0.001 and through[2] == whole[2] + 12  # the cube's sides
    assert open_[0] > 0.001 and open_[1] > 0.03


def test_section_plane_removes_the_tissue_beyond(bin, mesh):
    low, none, turned = draw(bin, mesh, "--clip", "0,0,1,-49.9"), draw(bin, mesh, "--clip", "0,0,1,60"), draw(bin, mesh, "--clip", "0,0,-1,-49.9")
    assert none == draw(bin, mesh) and low[0] == 0 and turned[0] == 0
    done = run(bin, mesh, "--png", mesh.with_suffix(".png"), *FLAT, "--clip", "0,0,1,-60")
    assert done.returncode == 2 and "--clip hides all of it" in done.stderr


def test_up_is_either_way(bin, mesh):
    flat = draw(bin, mesh, "--clip", "0,1,0,-45", "--up", "y", "--elevation", "80")   # its cap faces the eye
    other = draw(bin, mesh, "--clip", "0,1,0,-45", "--up", "-y", "--elevation", "80")  # its back does
    assert flat != other


def test_the_last_of_many_regions_has_its_colour(bin, tmp_path):
    """As of several bodies; regions beyond those that the shader knew had the colour of the first."""
    m, path = meshlib.block(3), tmp_path / "block.msh"
    m.names = {(3, i + 1): f"part_{i}" if i < 39 else "vein" for i in range(40)}
    m.region = [40 if all(m.points[v][2] > 0.066 and m.points[v][1] < 0.067 for v in t) else 1 if i % 2 else 2 + i % 38 for i, t in enumerate(m.tets)]
    path.write_text(meshlib.msh2(m))
    assert draw(bin, path)[0] > 0.03


@pytest.mark.parametrize("args,said", [(("--clip", "0,0,0"), "not a direction"), (("--clip", "1,2"), "for example --clip 0,-1,0,10"), (("--through", "1"), "from 0 to 0.95"), (("--up", "-w"), "or -x, -y or -z")])
def test_bad_input(bin, mesh, args, said):
    done = run(bin, mesh, "--png", mesh.with_suffix(".png"), *args)
    assert done.returncode == 2 and said in done.stderr


def test_a_log_is_not_cut(bin, tmp_path):
    done = run(bin, tmp_path / "a.lcm", "--png", tmp_path / "a.png", "--clip", "0,0,1")
    assert done.returncode == 2 and "a log has only the surface" in done.stderr


def test_a_log_with_its_scene_has_their_colours(bin, tmp_path):
    m, path = meshlib.block(3), tmp_path / "block.msh"
    m.names = {(3, 1): "liver", (3, 2): "vein"}
    m.region = [2 if all(m.points[v][2] > 0.066 and m.points[v][1] < 0.034 for v in t) else 1 for t in m.tets]
    path.write_text(meshlib.msh2(m))
    for command in (("tm-scene", "new", path), ("tm-sim", path.with_suffix(".yaml"), "--lockstep", "--duration", "0.2", "--record", tmp_path / "a.lcm")):
        subprocess.run([bin / command[0], *command[1:]], check=True, capture_output=True, timeout=300)
    seen = {}
    for scene in ((), ("--scene", path.with_suffix(".yaml"), "--no-supports")):
        done = run(bin, tmp_path / "a.lcm", "--png", tmp_path / "a.png", *FLAT, *scene)
        assert done.returncode == 0, done.stderr
        seen[bool(scene)] = share(pixels(tmp_path / "a.png"), blue)
    assert seen[False] == 0 and seen[True] > 0.01


def test_video_of_a_log_shows_inner_regions(bin, mesh, tmp_path):
    """The vein is nowhere on the log's surface; --through shows it from the scene."""
    scene = tmp_path / "block.yaml"
    subprocess.run([bin / "tm-scene", "new", mesh, "-o", scene], check=True, capture_output=True, timeout=300)
    subprocess.run([bin / "tm-sim", scene, "--lockstep", "--duration", "1.5", "--record", tmp_path / "a.lcm"], check=True, capture_output=True, timeout=300)
    words, seen = ("--scene", scene, "--no-supports"), {}
    for name, through in (("closed", ()), ("open", ("--through", "0.8"))):
        done = run(bin, tmp_path / "a.lcm", "--frames", tmp_path / name, "--fps", "1", *FLAT, *words, *through)
        assert done.returncode == 0, done.stderr
        seen[name] = [pixels(tmp_path / name / f"frame_{i:05d}.png") for i in (0, 1)]
    assert share(seen["closed"][1], blue) == 0 and min(share(p, blue) for p in seen["open"]) > 0.005
    done = run(bin, tmp_path / "a.lcm", "--png", tmp_path / "a.png", "--through", "0.5")
    assert done.returncode == 2 and "--scene FILE" in done.stderr
