"""Bad input: exit 2, `file:line: what; what to do`, nothing written."""
import json
import re
import subprocess

import pytest
from simkit import BLOCK, block_scene, run

BASE = BLOCK.lstrip()


def refuse(bin, scene, tmp_path, *args):
    before = sorted(tmp_path.rglob("*"))
    _, said = run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, "--json", tmp_path / "o.json", "--csv", tmp_path / "o.csv",
                  "--samples", tmp_path / "s.csv", "--record", tmp_path / "o.lcm", *args, code=2)
    assert sorted(tmp_path.rglob("*")) == before
    assert said.count("\n") == 1 and ";" in said, said
    return said


# (scene text with {mesh}, line of the error, words of the message)
BAD = {
    "unknown key": (BASE.replace("young", "yung"), 5, "unknown key 'yung' in tissue.materials.*; did you mean 'young'?"),
    "unknown top key": (BASE + "gravty:\n", 8, "did you mean 'gravity'?"),
    "far off key": (BASE + "zzzzzzzzz: 1\n", 8, "use one of: title, model"),
    "wrong unit": (BASE.replace("10 kPa", "10 mm"), 5, "'mm' is a length where a pressure is expected; write it in Pa"),
    "unknown unit": (BASE.replace("10 kPa", "10 furlong"), 5, "unknown unit 'furlong'; a pressure is written in Pa"),
    "not a number": (BASE.replace("10 kPa", "soft"), 5, "'soft' is not a number"),
    "nan": (BASE.replace("10 kPa", "nan"), 5, "not a number"),
    "infinite": (BASE.replace("10 kPa", "1e999"), 5, "not finite"),
    "hexadecimal": (BASE.replace("10 kPa", "0x10"), 5, "not a number"),
    "out of range": (BASE + "time: {{frame_rate: 0.1 Hz}}\n", 8, "outside"),
    "not yaml": (BASE + "time: [\n", 9, "not YAML"),
    "tab": (BASE + "time:\n\tduration: 1\n", 9, "not YAML"),
    "empty": ("", 1, "empty"),
    "only a comment": ("# nothing\n", 1, "empty"),
    "a list": ("- 1\n", 1, "is a list"),
    "two documents": (BASE + "---\ntissue:\n", 8, "second document"),
    "key twice": (BASE + "gravity:\ngravity:\n", 9, "key 'gravity' is already given ({scene}:8); keep one"),
    "missing key": (BASE.replace("  mesh: {mesh}\n", ""), 1, "key 'mesh' is missing"),
    "missing mesh": (BASE.replace("{mesh}", "nowhere.msh"), 2, "nowhere.msh cannot be read"),
    "value missing": (BASE.replace("plain", ""), 3, "has no value"),
    "choice": (BASE.replace("plain", "fastest"), 3, "use one of: best plain"),
    "shape": (BASE.replace("plain", "[1]"), 3, "is a list"),
    "vector too short": (BASE + "gravity: {{acceleration: [0, 1]}}\n", 8, "2 components"),
    "half a family": (BASE.replace(", poisson: 0.4", ""), 5, "lacks some of its constants; give all of: young poisson"),
    "two families": (BASE.replace("poisson: 0.4", "poisson: 0.4, mu: 3 kPa"), 5, "mixes families"),
    "indefinite": (BASE.replace("0.4", "0.5"), 5, "material '*'"),
    "no such region": (BASE.replace('"*"', "liver"), 5, "no region 'liver'; it has: tissue"),
    "no such group": (BASE.replace("z_min", "bottom"), 7, "no group 'bottom'; it has: "),
    "no selector": (BASE.replace(", group: z_min", ""), 7, "selects no vertices"),
    "two selectors": (BASE.replace("group: z_min", "group: z_min, vertex: 1"), 7, "2 selectors"),
    "no such vertex": (BASE.replace("group: z_min", "vertex: 999999"), 7, "vertex 999999 does not exist"),
    "empty box": (BASE.replace("group: z_min", "box: {{min: [5, 5, 5], max: [6, 6, 6]}}"), 7, "contains no vertex"),
    "box inside out": (BASE.replace("group: z_min", "box: {{min: [1, 0, 0], max: [0, 1, 1]}}"), 7, "below box.min"),
    "zero normal": (BASE.replace("group: z_min", "plane: {{point: [0, 0, 0], normal: [0, 0, 0]}}"), 7, "plane.normal is zero"),
    "supports contradict": (BASE + "  - {{group: x_min, displace: [1 mm, 0, 0]}}\n", 8, "already fixed at 0 m along x by another support ({scene}:7); make"),
    "axes": (BASE.replace("group: z_min", "group: z_min, axes: w"), 7, "axes 'w'"),
    "free axis moved": (BASE.replace("group: z_min", "group: z_min, axes: xy, displace: [0, 0, 1 mm]"), 7, "is not in its axes"),
    "load without force": (BASE + "loads:\n  - {{group: z_max}}\n", 9, "either a force, a total, a traction or a pressure"),
    "fibred without fibres": (BASE.replace("young: 10 kPa, poisson: 0.4", "lambda_T: 1 kPa, mu_T: 1 kPa, lambda_L: 2 kPa, mu_L: 2 kPa"), 5, "add 'anisotropy:'"),
    "fibres twice": (BASE + "anisotropy: {{rule: constant, file: a.csv}}\n", 8, "either a file or a rule"),
    "fibre file missing": (BASE + "anisotropy: {{file: a.csv}}\n", 8, "a.csv: cannot open"),
    "damping not named": (BASE.replace("poisson: 0.4", "poisson: 0.4, damping: 3 /s"), 5, "add 'damping:'"),
    "contact without tool": (BASE + "contact:\n", 8, "needs instruments"),
    "haptics without tool": (BASE + "haptics:\n", 8, "needs instruments"),
    "fibre file is a folder": (BASE + "anisotropy: {{file: .}}\n", 8, "anisotropy.file: "),
    "mesh is a folder": (BASE.replace("{mesh}", "."), 2, "is not a file; name a .msh"),
    "asterisk": (BASE.replace('"*"', "*"), 5, 'put the asterisk in quotes: "*":'),
    "tabs": (BASE.replace("  mesh", "\tmesh"), 2, "indent with spaces, not with tabs"),
    "comma": (BASE.replace("{{young: 10 kPa, poisson: 0.4}}", "\n      young: 5,0 kPa\n      poisson: 0.4"), 6, "has a decimal comma; write a point: 5.0 kPa"),
    "comma in braces": (BASE.replace("10 kPa", "5,0 kPa"), 5, "a comma separates entries; write a decimal point"),
    "unit in small letters": (BASE.replace("10 kPa", "10 kpa"), 5, "unknown unit 'kpa'; did you mean 'kPa'?"),
    "axis of nothing": (BASE + "instruments:\n  - {{trocar: [0, 0, 1], axis: [0, 0, 0]}}\n", 9, "axis is zero; give the direction"),
    "axis next to nothing": (BASE + "instruments:\n  - {{trocar: [0, 0, 1], axis: [0, 0, 1e-150]}}\n", 9, "no orientation"),
    "up of nothing": (BASE + "instruments:\n  - {{trocar: [0, 0, 1], up: [0, 0, 0]}}\n", 9, "up is zero; give a direction"),
    "trocar beyond": (BASE + "instruments:\n  - {{trocar: [0, 0, 1e300]}}\n", 9, "the trocar is 1e+300 m from the origin; keep it within 1000 m"),
    "supports of nothing": (BASE[:BASE.index("  - ")], 6, "supports has nothing under it; write at least one line that begins with '- '"),
    "three instruments": (BASE + "instruments: [{{trocar: [0,0,1]}}, {{trocar: [0,0,1]}}, {{trocar: [0,0,1]}}]\n", 8, "the scene has 3 instruments; give one or two"),
    "axis along up": (BASE + "instruments:\n  - {{trocar: [0, 0, 1], axis: [0, 1, 0], up: [0, 2, 0]}}\n", 9, "parallel"),
    "pose twice": (BASE + "instruments:\n  - trocar: [0, 0, 20 cm]\n    start: {{tip: [0, 0, 10 cm], pitch: 3 deg}}\n", 10, "leave one out"),
    "trocar missing": (BASE + "instruments:\n  - {{mode: probe}}\n", 9, "instruments[0]: key 'trocar' is missing; add the pivot of the instrument, or 'mount: free'"),
    "origin missing": (BASE + "instruments:\n  - device: inverse3\n    mount: free\n", 10, "key 'origin' is missing; add the point"),
    "free in a trocar": (BASE + "instruments:\n  - {{mount: free, trocar: [0, 0, 1], origin: [0, 0, 1]}}\n", 9, "is free and has a trocar; leave it out"),
    "origin of a trocar": (BASE + "instruments:\n  - {{trocar: [0, 0, 1], origin: [0, 0, 1]}}\n", 9, "has a trocar; leave it out, or take 'mount: free'"),
    "free gimbal": (BASE + "instruments:\n  - mount: free\n    origin: [0, 0, 0]\n", 9, "device 'impulse_engine' turns about a trocar, and instrument 0 has none"),
    "tilt without sensor": (BASE + "instruments:\n  - mount: free\n    device: touch\n    origin: [0, 0, 0]\n    start: {{tip: [0, 0, 5 cm], pitch: 3 deg}}\n", 12, "touch, reports no direction"),
    "free tip beyond": (BASE + "instruments:\n  - mount: free\n    device: touch\n    origin: [0, 0, 0]\n    start: {{tip: [0, 0, 5]}}\n", 12, "the tip is 5 m from the origin; keep it within 0.5 m"),
    "free tip and insertion": (BASE + "instruments:\n  - mount: free\n    device: touch\n    origin: [0, 0, 0]\n    start: {{tip: [0, 0, 0], insertion: 1 cm}}\n", 12, "tip as well as insertion"),
    "free shaft past tissue": (BASE + "instruments:\n  - mount: free\n    device: touch\n    origin: [0, 0, 0]\n    start: {{tip: [40 cm, 0, 0], above: 1 mm}}\n", 12, "through this tip does not meet the tissue"),
    "hand without tool": (BASE + "hand:\n  - path: [{{time: 0}}]\n", 9, "hand is for instrument 0"),
    "path out of order": (BASE + "instruments:\n  - trocar: [0, 0, 20 cm]\nhand:\n  - path: [{{time: 1}}, {{time: 1}}]\n", 11, "order them by time"),
    "single and free": (BASE.replace("group: z_min", "vertex: 0").replace("tissue:", "tissue:\n  precision: single"), 2, "leave its connected piece free to move"),
    "step too large": (BASE + "time: {{step: 0.1 s}}\n", 8, "guaranteed critical step"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_scene_is_refused_with_its_line(bin, root, tmp_path, what):
    text, line, words = BAD[what]
    scene = tmp_path / "bad.yaml"
    scene.write_text(text.format(mesh=root / "meshes" / "block_1k.msh"))
    said = refuse(bin, scene, tmp_path)
    assert words.replace("{scene}", str(scene)) in said, said
    if line:
        assert said.startswith(f"{scene}:{line}: "), said


def write_mesh(path, nodes, tets):
    path.write_text("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n%d\n%s\n$EndNodes\n$Elements\n%d\n%s\n$EndElements\n" % (
        len(nodes), "\n".join(f"{i + 1} {p}" for i, p in enumerate(nodes)),
        len(tets), "\n".join(f"{i + 1} 4 2 1 1 {t}" for i, t in enumerate(tets))))


GOOD_NODES = ["0 0 0", "1 0 0", "0 1 0", "0 0 1", "1 1 1"]
MESHES = {
    "flat": (["0 0 0", "1 0 0", "0 1 0", "1 1 0"], ["1 2 3 4"]),
    "not finite": (["0 0 0", "1 0 0", "0 nan 0", "0 0 1"], ["1 2 3 4"]),
    "vertex twice": (GOOD_NODES[:4], ["1 2 3 3"]),
    "unused vertex": (GOOD_NODES, ["1 2 3 4"]),
    "no tetrahedra": (GOOD_NODES[:4], []),
    "inverted": (GOOD_NODES[:4], ["1 3 2 4"]),
}


@pytest.mark.parametrize("what", MESHES)
def test_bad_mesh_is_refused_with_its_reason(bin, tmp_path, what):
    write_mesh(tmp_path / "bad.msh", *MESHES[what])
    scene = tmp_path / "scene.yaml"
    scene.write_text(BASE.format(mesh="bad.msh").replace("group: z_min", "vertex: 0"))
    cache = {"TM_CACHE_DIR": str(tmp_path.parent / "cache")}
    before = sorted(tmp_path.rglob("*"))
    _, said = run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, "--json", tmp_path / "o.json", code=2, env=cache)
    assert said.startswith(str(tmp_path / "bad.msh")) and ";" in said and said.endswith(f"(the scene names it: {scene}:2)\n"), said
    assert sorted(tmp_path.rglob("*")) == before


COMMANDS = {
    "no arguments": ([], "the scene is missing"),
    "unknown option": (["--fast"], "'--fast'"),
    "no mode": (["{scene}"], "the mode is missing"),
    "two modes": (["{scene}", "--lockstep", "--realtime"], "two modes"),
    "two scenes": (["{scene}", "{scene}", "--lockstep"], "second scene"),
    "missing file": (["/nowhere/scene.yaml", "--lockstep"], "cannot be read"),
    "a folder": (["{folder}", "--lockstep"], "regular file"),
    "settle word": (["{scene}", "--settle", "much"], "not a number"),
    "settle zero": (["{scene}", "--settle", "0"], "below"),
    "duration unit": (["{scene}", "--lockstep", "--duration", "5 kg"], "is a mass where a time"),
    "frames fraction": (["{scene}", "--lockstep", "--frames", "1.5"], "whole number"),
    "set without value": (["{scene}", "--lockstep", "--set", "gravity"], "PATH=VALUE"),
    "set unknown": (["{scene}", "--lockstep", "--set", "tissue.colour=red"], "unknown key 'colour' in tissue"),
    "set wrong": (["{scene}", "--lockstep", "--set", "tissue.scale=3 mm"], "--set tissue.scale=3 mm: "),
    "set next item of a new list": (["{scene}", "--lockstep", "--set", "viscosity.terms[1].time=0.2"], "nor is it the next one; write [0]"),
    "set part of a new item": (["{scene}", "--lockstep", "--set", "viscosity.terms[0].time=0.2"], "viscosity.terms[0]: key 'shear' is missing"),
    "set item of no list": (["{scene}", "--lockstep", "--set", "tissue[0].mesh=a"], "not to a list; leave the brackets out"),
    "set no item": (["{scene}", "--lockstep", "--set", "supports[7].axes=x"], "list item [7].axes does not exist; give an index below 1"),
    "unset nothing": (["{scene}", "--lockstep", "--unset", "gravity"], "no 'gravity' to leave out"),
    "write without settle": (["{scene}", "--lockstep", "--write", "a.vtk"], "--settle"),
    "write what": (["{scene}", "--settle", "1e-6", "--write", "a.obj"], ".vtk nor .csv"),
    "nowhere to write": (["{scene}", "--lockstep", "--frames", "1", "--json", "/nowhere/o.json"], "/nowhere/o.json"),
    "schema": (["--schema", "html"], "use markdown"),
}


@pytest.mark.parametrize("what", COMMANDS)
def test_bad_command_line_is_refused(bin, root, tmp_path, what):
    args, words = COMMANDS[what]
    scene = block_scene(tmp_path, root)
    _, said = run(bin / "tm-sim", *[a.format(scene=scene, folder=tmp_path) for a in args], code=2)
    assert words in said and ";" in said and said.count("\n") == 1, said


@pytest.mark.parametrize("more, place", [
    (['tissue.materials={"*": {young: 1 kPa, young: 2 kPa, poisson: 0.4}}'], "key 'young' is already given"),
    (["supports=[{group: x_min}, {group: x_min, displace: [1 mm, 0, 0]}]"], "by another support"),
    (["contact=", "haptics.compliance=iterations", "instruments=[{trocar: [50 mm, 50 mm, 180 mm]}]", "rotation="], "with rotation"),
])
def test_places_that_came_by_set_are_named_by_their_text(bin, root, tmp_path, more, place):
    """A second place in a message: the option's text, never a line below zero."""
    scene = block_scene(tmp_path, root)
    said = subprocess.run([bin / "tm-sim", scene, "--explain", *(word for one in more for word in ("--set", one))], capture_output=True, text=True, timeout=60).stderr
    assert f"{place} (--set {more[-1]})" in said and "line -" not in said, said


def test_help_and_version(bin):
    out, _ = run(bin / "tm-sim", "--help")
    for option in ("--lockstep", "--realtime", "--settle", "--explain", "--json", "--record", "--set"):
        assert option in out
    assert re.fullmatch(r"tm-sim \d+\.\d+\.\d+\n", run(bin / "tm-sim", "--version")[0])


def test_committed_reference_is_the_generated_one(bin, root):
    out, _ = run(bin / "tm-sim", "--schema", "markdown")
    assert out == (root / "docs" / "scene-reference.md").read_text(), "run: build/bin/tm-sim --schema markdown > docs/scene-reference.md"


@pytest.mark.parametrize("path,written,si", [
    ("tissue.materials.*.young", ["10 kPa", "10kPa", "0.01 MPa", "1e4 Pa", "10000 N/m2"], "10000"),
    ("tissue.materials.*.density", ["1.05 g/cm3", "1050 kg/m^3", "1.05 g/ml"], "1050"),
    ("damping.rate", ["0.02 kHz", "20 /s", "20 1/s"], "20"),
    ("time.frame_rate", ["25 Hz", "+25"], "25"),
    ("instruments[0].trocar", ["[5 cm, 50 mm, 18e4 um]", "[0.05 m, .05, 180 mm]"], "[0.05, 0.05, 0.18]"),
    ("instruments[0].start.pitch", ["30 deg", "523.598775598298873 mrad"], "0.523598775598298873"),
    ("contact.compliance", ["1 mm/N"], "0.001"),
    ("haptics.loss", ["25 %"], "0.25"),
])
def test_units_mean_what_they_say(bin, root, tmp_path, path, written, si):
    """The same run, bit for bit in its trace, for any notation of the numbers."""
    scene = block_scene(tmp_path, root, "damping:\ncontact:\nhaptics:\ninstruments:\n  - trocar: [50 mm, 50 mm, 18 cm]\n    start: {insertion: 13 cm}\n")

    def trace(value):
        run(bin / "tm-sim", scene, "--lockstep", "--duration", "0.3 s", "--set", f"{path}={value}", "--csv", tmp_path / "t.csv", "--samples", tmp_path / "s.csv")
        return [float(x) for name in ("t.csv", "s.csv") for line in (tmp_path / name).read_text().splitlines()[1:] for x in line.split(",")]

    expected = trace(si)
    assert max(map(abs, expected)) > 0
    for value in written:
        assert trace(value) == pytest.approx(expected, rel=1e-6, abs=1e-9), value


def test_set_makes_a_list_that_the_scene_does_not_have(bin, root, tmp_path):
    """--set item by item and key by key: the run of the scene with these keys, bit for bit."""
    def trace(scene, *sets):
        run(bin / "tm-sim", scene, "--lockstep", "--duration", "0.2 s", *[w for s in sets for w in ("--set", s)], "--json", tmp_path / "t.json")
        return json.loads((tmp_path / "t.json").read_text())["state_hash"]

    named = trace(block_scene(tmp_path, root, "gravity:\nviscosity:\n  terms:\n    - {time: 0.2, shear: 0.3}\n    - {time: 20 ms, shear: 0.1}\n"))
    plain = block_scene(tmp_path, root, "gravity:\n")
    assert trace(plain, "viscosity.terms[0].time=0.2", "viscosity.terms[0].shear=0.3", "viscosity.terms[1]={time: 20 ms, shear: 0.1}") == named
    assert trace(plain) != named
