"""docs/your-own-organ.md as written: its commands, on the liver's surface as STL in millimetres."""
import json
import os
import re
import subprocess

import meshlib
from test_fill import binary


def surface_of(path):
    """Returns the outer triangles of a generated mesh, in mm."""
    lines = path.read_text().split("\n")
    i = lines.index("$Nodes")
    points = [tuple(1e3 * float(x) for x in l.split()[1:]) for l in lines[i + 2:i + 2 + int(lines[i + 1])]]
    i = lines.index("$Elements")
    rows = [l.split() for l in lines[i + 2:i + 2 + int(lines[i + 1])]]
    return [tuple(points[int(v) - 1] for v in r[5:]) for r in rows if r[1] == "2"]


def test_the_page_works_as_written(bin, root, env, tmp_path):
    page = (root / "docs" / "your-own-organ.md").read_text()
    (tmp_path / "organ.stl").write_bytes(binary(surface_of(root / "meshes" / "liver_1k.msh")))
    commands = [l.strip() for l in page.split("\n") if l.startswith("    tm-")]
    # The example from an image: tests/organ. From a mesh: the same folder from another source. A session depends on the wall clock: tests/install/test_live.py.
    commands = [c + " --no-video" * c.startswith("tm-organ") for c in commands if not re.match("tm-organ (seg|organ.msh)|tm-session", c)]
    assert len(commands) == 4
    env["PATH"] = f"{bin}:{os.environ['PATH']}"
    for command in commands:
        result = subprocess.run(command, shell=True, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=400)
        assert result.returncode == 0, f"{command}\n{result.stdout}{result.stderr}"
    assert json.loads((tmp_path / "felt/press.json").read_text())["force_N"]["peak"] > 0.1, "nothing was pressed"
    assert (tmp_path / "inside.png").read_bytes()[:4] == (tmp_path / "open.png").read_bytes()[:4] == b"\x89PNG"


def test_its_troubleshooting_says_what_the_programs_say(bin, root, env, tmp_path):
    page = (root / "docs" / "your-own-organ.md").read_text()
    (tmp_path / "organ.msh").write_text(meshlib.msh2(meshlib.block()))
    meshlib.run(bin / "tm-scene", "new", tmp_path / "organ.msh", env=env)
    scene = tmp_path / "organ.yaml"
    scene.write_text(re.sub(r"plane: {.*}}", "plane: {point: [9, 9, 9], normal: [1, 0, 0]}}", scene.read_text()))
    result = meshlib.run(bin / "tm-sim", scene, "--check", env=env)
    assert result.returncode == 2 and re.search(r"`(the selector contains no vertex[^`]*)`", page).group(1) in result.stderr
