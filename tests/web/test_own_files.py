"""Files that are dropped on the page have names only; a scene finds them by the paths that it writes (web/page/own_mesh.js)."""
import json
import shutil
import subprocess

import pytest
from paths import ROOT

SCENE = """
bodies:
  liver: {mesh: ../../meshes/liver.msh}
  gallbladder: {mesh: "organs/gallbladder.msh"}
  stand: {mesh: stand.msh, rigid: yes}
"""


@pytest.mark.skipif(not shutil.which("node"), reason="node is not installed")
def test_a_scene_finds_dropped_meshes_by_its_paths(tmp_path):
    shutil.copy(ROOT / "web/page/own_mesh.js", tmp_path / "own_mesh.mjs")
    (tmp_path / "run.mjs").write_text(
        f"import {{ byPaths }} from './own_mesh.mjs';\nconst given = {{'liver.msh': 1, 'gallbladder.msh': 2, 'stand.msh': 3}};\n"
        f"console.log(JSON.stringify(byPaths({json.dumps(SCENE)}, given)));\n")
    ran = subprocess.run(["node", tmp_path / "run.mjs"], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout) == {"liver.msh": 1, "gallbladder.msh": 2, "stand.msh": 3, "../../meshes/liver.msh": 1, "organs/gallbladder.msh": 2}
