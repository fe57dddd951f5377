"""Valid settings that are probably mistakes: one line on stderr with the place and the remedy, and the run continues; --strict ends it."""
import json
import subprocess
import sys

import numpy as np
import pytest
from paths import ROOT
from simkit import BLOCK, block_scene, run
from test_lockstep import columns

BASE = BLOCK.lstrip()
TOOL = "instruments:\n  - trocar: [0.05, 0.05, 0.2]\n    start: {{tip: [0.05, 0.05, 0.1]}}\n"

# (scene text with {mesh}, line, words)
WARN = {
    "millimetres": (BASE.replace("  force: plain", "  scale: 1000"), 3, "the mesh is 100 m across; if its file is in millimetres, write tissue.scale: 1"),
    "micrometres": (BASE.replace("  force: plain", "  scale: 5e-3"), 3, "the mesh is 0.5 mm across; check tissue.scale"),
    "pascal": (BASE.replace("10 kPa", "10"), 5, "10 Pa is softer than any tissue, and a number without a unit is in Pa; write kPa"),
    "falls": (BASE[:BASE.index("supports")] + "gravity:\n", 6, "gravity acts and nothing holds the tissue, so it falls without end; add 'supports:'"),
    "fibres of nothing": (BASE + "anisotropy: {{rule: constant}}\n", 8, "fibres have no effect, because every material is isotropic; give a material"),
    "no contact": (BASE + TOOL, 9, "instruments cannot touch the tissue: the scene does not name the effect 'contact'; add 'contact:'"),
    "starts inside": (BASE + "contact:\n" + TOOL.replace("0.1]", "0.03]"), 11, "instrument 0 starts inside the tissue and makes no contact until it has come out; start it outside"),
    "far trocar": (BASE + "contact:\n" + TOOL.replace("0.2]", "8]").replace("    start: {{tip: [0.05, 0.05, 0.1]}}\n", ""), 10, "the trocar of instrument 0 is 7.95 m from the tissue and its shaft is 0.5 m long; move it"),
}


@pytest.mark.parametrize("what", WARN)
def test_warning_is_printed_and_the_run_continues(bin, root, tmp_path, what):
    text, line, words = WARN[what]
    scene = tmp_path / "scene.yaml"
    scene.write_text(text.format(mesh=root / "meshes" / "block_1k.msh"))
    _, said = run(bin / "tm-sim", scene, "--lockstep", "--frames", 1)
    assert said.startswith(f"{scene}:{line}: warning: ") and words in said and said.count("\n") == 1, said
    _, said = run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, "--strict", "--json", tmp_path / "o.json", code=2)
    assert words in said and not (tmp_path / "o.json").exists()


def test_shipped_scenes_have_no_warnings(bin, root):
    scenes = sorted((root / "apps/scenes").glob("*.yaml"))
    assert len(scenes) > 8
    for scene in scenes:
        assert run(bin / "tm-sim", scene, "--check", "--strict")[1] == "" or "precomputed" in scene.name or "hybrid" in scene.name


PATH = """contact:
instruments:
  - trocar: [0.05, 0.05, 0.2]
hand:
  - instrument: 0
    path: [{{time: 0, tip: [0.05, 0.05, 0.1]}}, {{time: 0.4, tip: [0.05, 0.05, {z}]}}, {{time: 0.8, tip: [0.05, 0.05, 0.1]}}]
"""


def test_a_tool_that_never_touched_is_told_with_how_near_it_came_and_when(bin, root, tmp_path):
    scene = block_scene(tmp_path, root, PATH.format(z=0.0562))
    _, said = run(bin / "tm-sim", scene, "--lockstep", "--duration", "1 s")
    assert said.startswith(f"{scene}:10: warning: instrument 0 never touched the tissue: its tip came within 3.7 mm, at 0.4 s; move it nearer"), said
    assert run(bin / "tm-sim", scene, "--lockstep", "--duration", "0.2 s")[1] == ""  # it was approaching
    scene = block_scene(tmp_path, root, PATH.format(z=0.05))
    assert run(bin / "tm-sim", scene, "--lockstep", "--duration", "1 s")[1] == ""


# --- above the surface ---

def at(bin, scene, tmp_path, *more):
    """Insertions of the scripted hand, as passed to tm-device."""
    run(bin / "tm-sim", scene, "--hands", tmp_path / "hand", *more)
    return columns(tmp_path / "hand0.csv")["insertion_m"]


def above_scene(tmp_path, root, waypoints, tool="trocar: [0.05, 0.05, 0.2]"):
    return block_scene(tmp_path, root, "contact:\ninstruments:\n  - {" + tool + ", radius: 2.5 mm}\nhand:\n  - path:\n" + "".join(f"    - {{time: {t}, {w}}}\n" for t, w in enumerate(waypoints)))


def test_a_waypoint_above_the_surface(bin, root, tmp_path):
    """The block's top is at 0.05 m: a tip of 2.5 mm touches with its centre at 0.0525, 0.1475 m from the trocar."""
    scene = above_scene(tmp_path, root, ["above: 2 mm", "above: 0", "above: -3 mm", "tip: [0.05, 0.05, 0.1], above: 1 mm"])
    assert at(bin, scene, tmp_path) == pytest.approx([0.1455, 0.1475, 0.1505, 0.1465], abs=1e-12)


def test_along_the_shaft_it_is_not_along_the_normal(bin, root, tmp_path):
    scene = above_scene(tmp_path, root, ["pitch: 10 deg, above: 0", "pitch: 10 deg, above: 4 mm"])
    touch = 0.1475 / np.cos(np.radians(10))
    assert at(bin, scene, tmp_path) == pytest.approx([touch, touch - 0.004], abs=1e-12)


def test_an_edge_and_a_corner_are_touched_where_a_sphere_touches_them(bin, root, tmp_path):
    """1 mm past the edge x = 0.1, and past the corner by 1 mm in x and y: the sphere's centre is sqrt(r2 - d2) above."""
    scene = above_scene(tmp_path, root, ["above: 0"], "trocar: [0.101, 0.05, 0.2]")
    assert at(bin, scene, tmp_path)[0] == pytest.approx(0.15 - np.sqrt(2.5e-3**2 - 1e-6), abs=1e-9)
    scene = above_scene(tmp_path, root, ["above: 0"], "trocar: [0.101, 0.101, 0.2]")
    assert at(bin, scene, tmp_path)[0] == pytest.approx(0.15 - np.sqrt(2.5e-3**2 - 2e-6), abs=1e-9)


def test_it_touches_where_it_says(bin, root, tmp_path):
    """In the simulation itself: no row a tenth of a millimetre above, rows a tenth below."""
    for above, touches in (("0.1 mm", False), ("-0.1 mm", True)):
        scene = above_scene(tmp_path, root, [f"pitch: 10 deg, yaw: 5 deg, above: {above}"] * 2)
        run(bin / "tm-sim", scene, "--lockstep", "--frames", 3, "--samples", tmp_path / "s.csv")
        assert (columns(tmp_path / "s.csv")["rows"][-1] > 0) == touches


def test_the_start_above_the_surface(bin, root, tmp_path):
    scene = block_scene(tmp_path, root, "contact:\ninstruments:\n  - {trocar: [0.05, 0.05, 0.2], start: {above: 5 mm}}\n")
    run(bin / "tm-sim", scene, "--hands", tmp_path / "hand")
    assert json.loads((tmp_path / "hand.json").read_text())["instruments"][0]["start_joint"][2] == pytest.approx(0.1425, abs=1e-12)


BAD = {
    "misses": ("yaw: 80 deg, above: 1 mm", "does not meet the tissue in this direction; change pitch"),
    "with insertion": ("insertion: 5 cm, above: 1 mm", "a pose has both insertion and above; leave one out"),
    "out of reach": ("above: -0.4 m", "which makes the insertion 0.5475 m; keep it between"),
    "behind the trocar": ("above: 0.2 m", "keep it between 1 mm and 0.5 m"),
    "unit": ("above: 2 kPa", "is a pressure where a length is expected"),
    "too much": ("above: 2", "outside -0.5 to 0.5"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_waypoints(bin, root, tmp_path, what):
    waypoint, words = BAD[what]
    scene = above_scene(tmp_path, root, ["above: 1 mm", waypoint])
    _, said = run(bin / "tm-sim", scene, "--check", code=2)
    assert said.startswith(f"{scene}:14: ") and words in said and ";" in said and said.count("\n") == 1, said


# --- limits of the YAML reader ---

MESH = "tissue:\n  mesh: nowhere.msh\n  materials:\n"
HUGE = {
    "depth": ("[" * 100000, 1, "more than 16 nested levels"),
    "depth of mappings": ("a: " + "{a: " * 50000, 1, "more than 16 nested levels"),
    "depth by keys": ("? " * 100000, 1, "more than 16 nested levels"),
    "anchors": ("".join(f"a{i}: &a{i} 1\n" for i in range(150000)), 65, "more than 64 anchors (&) and aliases (*); write"),
    "aliases": ("a: &a 1\nb: [" + "*a," * 150000 + "]\n", 2, "more than 64 anchors"),
    "directives": ("%TAG !a! x\n" * 300000, 5, "more than 4 lines that begin with %"),
    "materials": (MESH + "".join(f"    m{i}: {{young: 1}}\n" for i in range(150000)), 4, "has 150000 entries, more than 1000; write fewer"),
    "bytes": ("# " + "x" * (5 << 20), None, "is larger than 4 MB, the limit of a scene"),
}


@pytest.mark.parametrize("what", HUGE)
def test_oversized_yaml_is_refused(bin, tmp_path, what):
    text, line, words = HUGE[what]
    scene = tmp_path / "scene.yaml"
    scene.write_text(text)
    done = subprocess.run([bin / "tm-sim", scene, "--check"], capture_output=True, text=True, timeout=40)  # took a minute before
    assert done.returncode == 2 and words in done.stderr and ";" in done.stderr
    assert done.stderr.startswith(f"{scene}:{line}: " if line else f"{scene}: ")


@pytest.mark.parametrize("latency, rate, words", [
    (2, "25 Hz", "haptics.latency = 2 samples of 40 ms: a force is up to 122 ms old, and the controller ramps down forces older than 100 ms, so the hand feels little or nothing; give 1.4 at most"),
    (1, "10 Hz", "at a sample period of 100 ms a force is up to 202 ms old, and the controller ramps down forces older than 100 ms"),
    (1.4, "25 Hz", None),
])
def test_a_force_too_old_to_be_felt_is_told(bin, root, latency, rate, words):
    _, said = run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--duration", "0.2 s", "--set", f"haptics.latency={latency}", "--set", f"haptics.rate={rate}", "--set", "time.frame_rate=5 Hz")
    assert said.count("\n") == (words is not None) and (words or "") in said, said


def test_share_beyond_the_laws_range_is_reported(bin, root, tmp_path):
    """Pressed by 30 mm of 50 under a maximum stretch of 1.2: stated in the report and as a warning; a shallow press of the same scene gives no
    warning."""
    for depth, loud in (("30 mm", True), ("48 mm", False)):
        tips = [w for k in (2, 3) for w in ("--set", f"hand[0].path[{k}].tip=[52 mm, 50 mm, {depth}]")]
        _, said = run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--quiet", "--frames", 36, "--json", tmp_path / "o.json",
                      "--set", "tissue.materials.*.law=neo-hooke", "--set", "tissue.materials.*.stretch=1.2", *tips)
        tets = json.loads((tmp_path / "o.json").read_text())["limited_tets"]
        assert (tets > 11) == loud and (f"{tets} of 1176 tetrahedra were beyond the limit of their law" in said) == loud, said


def block(folder, constants, depth):
    """Returns a scene: a cube between glued plates, pressed by this share."""
    sys.path.insert(0, str(ROOT / "apps/studies/reality"))
    import bodies
    bodies.write_mesh(folder / "block.msh", *bodies.box((4, 4, 4), (0.03, 0.03, 0.03)))
    plane = "plane: {{point: [0, 0, {}], normal: [0, 0, 1]}}"
    scene = folder / "block.yaml"
    scene.write_text(f"""title: A block
tissue:
  mesh: block.msh
  materials:
    "*": {{young: 5 kPa, {constants}}}
supports:
  - {{{plane.format("0")}}}
  - {{{plane.format("30 mm")}, displace: [0, 0, {-30 * depth} mm]}}
""")
    return scene


@pytest.mark.parametrize("law, depth, loud", [("st-venant-kirchhoff", 0.4, True), ("st-venant-kirchhoff", 0.1, False), ("neo-hooke", 0.4, False)])
def test_volume_where_the_law_is_not_elliptic_is_reported(bin, tmp_path, law, depth, loud):
    scene = block(tmp_path, f"poisson: 0.45, law: {law}", depth)
    _, said = run(bin / "tm-sim", scene, "--settle", "1e-6", "--json", tmp_path / "o.json")
    share = json.loads((tmp_path / "o.json").read_text())["unstable_share"]
    assert (share > 0.005) == loud and (f"the law is not elliptic in {100 * share:.1f} % of the volume" in said) == loud, said


@pytest.mark.parametrize("constants, loud", [("poisson: 0", True), ("poisson: 0.45, compression: 0", True), ("poisson: 0.3", False)])
def test_a_law_whose_force_falls_under_compression_is_told(bin, tmp_path, constants, loud):
    _, said = run(bin / "tm-sim", block(tmp_path, f"{constants}, law: st-venant-kirchhoff", 0.1), "--check")
    assert ("its force falls when it is compressed to less than 0.58 of its length; use neo-hooke" in said) == loud, said


def test_a_law_that_needs_fibres_asks_for_them(bin, tmp_path):
    done = subprocess.run([bin / "tm-sim", block(tmp_path, "poisson: 0.4, law: holzapfel, k1: 1 kPa, k2: 1", 0.1), "--check"], capture_output=True, text=True)
    assert done.returncode == 2 and "add 'anisotropy:' with a file or a rule, or another 'law:'" in done.stderr
