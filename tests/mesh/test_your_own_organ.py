"""docs/your-own-organ.md, word for word: its scene and its commands, on the liver's surface as STL in millimetres."""
import json
import os
import re
import subprocess

import meshlib
from test_fill import binary


def surface_of(path):
    """Outer triangles of a generated mesh, in mm."""
    lines = path.read_text().split("\n")
    i = lines.index("$Nodes")
    points = [tuple(1e3 * float(x) for x in l.split()[1:]) for l in lines[i + 2:i + 2 + int(lines[i + 1])]]
    i = lines.index("$Elements")
    rows = [l.split() for l in lines[i + 2:i + 2 + int(lines[i + 1])]]
    return [tuple(points[int(v) - 1] for v in r[5:]) for r in rows if r[1] == "2"]


def test_the_page_works_as_written(bin, root, env, tmp_path):
    page = (root / "docs" / "your-own-organ.md").read_text()
    (tmp_path / "organ.yaml").write_text(re.search(r"```yaml\n(.*?)```", page, re.S).group(1))
    (tmp_path / "organ.stl").write_bytes(binary(surface_of(root / "meshes" / "liver_10k.msh")))
    commands = [l.strip() for l in page.split("\n") if l.startswith("    tm-")]
    assert len(commands) >= 8
    commands.pop(next(i for i, c in enumerate(commands) if c.startswith("tm-session")))  # watches the wall clock: tests/install/test_live.py
    env["PATH"] = f"{bin}:{os.environ['PATH']}"
    for command in commands:
        result = subprocess.run(command, shell=True, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=120)
        assert result.returncode == 0, f"{command}\n{result.stdout}{result.stderr}"
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["tets"] > 9000 and figures["force_N"]["peak"] > 0.1, "nothing was pressed"
    assert (tmp_path / "organ.png").read_bytes()[:4] == b"\x89PNG"


def test_its_troubleshooting_says_what_the_programs_say(bin, root, env, tmp_path):
    page = (root / "docs" / "your-own-organ.md").read_text()
    scene = re.search(r"```yaml\n(.*?)```", page, re.S).group(1)
    (tmp_path / "organ.msh").write_text(meshlib.msh2(meshlib.block()))
    (tmp_path / "organ.yaml").write_text(scene.replace("35 mm", "199 mm"))
    result = meshlib.run(bin / "tm-sim", tmp_path / "organ.yaml", "--check", env=env)
    assert result.returncode == 2 and re.search(r"`(the selector finds no vertex[^`]*)`", page).group(1) in result.stderr
