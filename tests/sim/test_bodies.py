"""Scenes of several bodies: `bodies:` in tm-sim and in Python."""
import re
import subprocess

import pytest
from simkit import report, run

HEAD = """\
tissue:
  force: plain
  materials:
    "*": {young: 5 kPa, poisson: 0.4}
%s
damping: {rate: 60 /s}
contact:
supports:
  - {name: base, group: %sz_min}
instruments:
  - mode: probe
    trocar: [50 mm, 50 mm, 180 mm]
hand:
  - instrument: 0
    path:
      - {time: 0 s, tip: [50 mm, 50 mm, 45 mm]}
      - {time: 0.2 s, tip: [52 mm, 50 mm, 35 mm]}
time: {frame_rate: 25 Hz, duration: 0.2 s}
"""


def write(path, text):
    path.write_text(text)
    return path


def state(bin, scene, tmp_path, *args):
    return report(bin / "tm-sim", scene, "--lockstep", *args, tmp=tmp_path)


@pytest.fixture
def block(root):
    return root / "meshes/block_1k.msh"


def test_one_body_is_the_plain_scene_bit_for_bit(bin, block, tmp_path):
    plain = HEAD.replace("  force: plain", f"  mesh: {block}\n  force: plain") % ("", "")
    one = HEAD % ("bodies:\n  block: {mesh: %s}" % block, "block.")
    said = [state(bin, write(tmp_path / f"{i}.yaml", text), tmp_path) for i, text in enumerate((plain, one))]
    assert said[0]["state_hash"] == said[1]["state_hash"]
    assert "bodies" not in said[0] and said[1]["bodies"] == [{"name": "block", "vertices": [0, said[1]["vertices"]], "tets": [0, said[1]["tets"]]}]


TWO = "bodies:\n  low: {mesh: %s}\n  high: {mesh: %s, move: [200 mm, 0, 0], turn: [0, 0, 90 deg]}"


def join(mesh, path):
    """Writes a Gmsh file with a mesh twice, in one place: regions low and high, groups low_x_min ... high_z_max."""
    def rows(name):
        return [line.split() for line in mesh.split(f"${name}\n")[1].split(f"$End{name}")[0].splitlines()[1:]]
    names, nodes, elements = [], [], []
    for k, body in enumerate(("low", "high")):
        names += [[dim, str(int(tag) + 100 * k), '"%s"' % (body if dim == "3" else f"{body}_{name[1:-1]}")] for dim, tag, name in rows("PhysicalNames")]
        nodes += [[str(int(tag) + 10000 * k), *x] for tag, *x in rows("Nodes")]
        elements += [[str(int(tag) + 10000 * k), kind, "2", *(str(int(t) + 100 * k) for t in rest[:2]), *(str(int(v) + 10000 * k) for v in rest[2:])] for tag, kind, _, *rest in rows("Elements")]
    sections = "".join("$%s\n%d\n%s\n$End%s\n" % (name, len(of), "\n".join(" ".join(row) for row in of), name) for name, of in (("PhysicalNames", names), ("Nodes", nodes), ("Elements", elements)))
    return write(path, "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n" + sections)


def test_parts_of_one_mesh_are_bodies(bin, block, tmp_path):
    """They have the bits of bodies with a file each, and each has its own regions and groups alone."""
    both = join(block.read_text(), tmp_path / "both.msh")
    head = HEAD.replace("time: {", "touch:\ntime: {")
    files = head % ("bodies:\n  a: {mesh: %s}\n  b: {mesh: %s, move: [5 mm, 0, 50.2 mm]}" % (block, block), "a.")
    parts = head % ("bodies:\n  a: {mesh: %s, part: low}\n  b: {mesh: %s, part: high_z_max, move: [5 mm, 0, 50.2 mm]}" % (both, both), "a.low_")
    said = [state(bin, write(tmp_path / f"{i}.yaml", text), tmp_path) for i, text in enumerate((files, parts))]
    assert said[0]["state_hash"] == said[1]["state_hash"] and said[0]["bodies"] == said[1]["bodies"]
    for change, words in ((("part: low", "part: middle"), r"bodies\.a\.part: the mesh has no region or group 'middle'; it has: low_x_min, .*high"), (("a.low_", "a.high_"), r"no group 'a\.high_z_min'")):
        scene = write(tmp_path / "bad.yaml", parts.replace(*change))
        error = run(bin / "tm-sim", scene, "--check", code=2)[1]
        assert re.search(r"bad\.yaml:\d+: .*" + words, error), error


def test_bodies_keep_their_numbers_and_materials(bin, block, tmp_path):
    text = HEAD % (TWO % (block, block), "low.")
    text = text.replace('"*": {young: 5 kPa, poisson: 0.4}', '"low.*": {young: 5 kPa, poisson: 0.4}\n    high.tissue: {young: 7 kPa, poisson: 0.3}')
    scene = write(tmp_path / "two.yaml", text)
    explained = run(bin / "tm-sim", scene, "--explain")[0]
    assert len(re.findall(r"^body ", explained, re.M)) == 2 and re.search(r"set by tetrahedron \d+ of body (low|high)\)", explained)
    alone, threads = state(bin, scene, tmp_path), state(bin, scene, tmp_path, "--set", "threads=2")
    assert alone["state_hash"] == threads["state_hash"]
    low, high = alone["bodies"]
    assert (low["name"], high["name"]) == ("low", "high") and low["tets"][1] == high["tets"][0] and high["tets"][1] == alone["tets"]
    other = state(bin, write(tmp_path / "soft.yaml", text.replace("7 kPa", "1 kPa")), tmp_path)
    assert other["dt_s"] == alone["dt_s"] and other["state_hash"] == alone["state_hash"]  # untouched, at rest
    hard = state(bin, write(tmp_path / "hard.yaml", text.replace("7 kPa", "70 kPa")), tmp_path)
    assert hard["dt_s"] < alone["dt_s"]


@pytest.mark.parametrize("change, words", [
    (("bodies:", "bodies:\n  self: {mesh: b.msh}"), "'self' cannot name a body"),
    (("bodies:", "bodies:\n  a.b: {mesh: b.msh}"), "'a.b' cannot name a body"),
    (("  force: plain", "  mesh: b.msh\n  force: plain"), "a scene has either tissue.mesh or 'bodies:'"),
    (("  force: plain", "  scale: 0.001\n  force: plain"), "write bodies.NAME.scale"),
    (("group: low.", "group: low"), "the mesh has no group 'lowz_min'; it has: low."),
    (('"*"', '"low.*"'), "region 'high.tissue' of the mesh has no material"),
    (('"*"', '"middle.*"'), "the mesh has no region 'middle.*'"),
    (("high: {mesh: ", "high: {mesh: nowhere"), "bodies.high.mesh: "),
], ids=["self", "dot", "mesh and bodies", "scale", "group", "no material", "no region", "no file"])
def test_faulty_bodies_are_refused_with_their_line(bin, block, tmp_path, change, words):
    text = HEAD % (TWO % (block, block), "low.")
    assert change[0] in text
    scene = write(tmp_path / "bad.yaml", text.replace(*change))
    said = run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, "--json", tmp_path / "o.json", code=2)[1]
    assert said.startswith(f"{scene}:") and words in said and ";" in said and not (tmp_path / "o.json").exists(), said


def test_a_setting_reaches_the_material_of_one_body(bin, block, tmp_path):
    """Keys of materials have dots: `low.*`."""
    text = (HEAD % (TWO % (block, block), "low.")).replace('"*": {young: 5 kPa, poisson: 0.4}', '"low.*": {young: 5 kPa, poisson: 0.4}\n    high.tissue: {young: 7 kPa, poisson: 0.3}')
    scene = write(tmp_path / "two.yaml", text)
    hard = state(bin, write(tmp_path / "hard.yaml", text.replace("7 kPa", "70 kPa").replace("5 kPa", "6 kPa")), tmp_path)["state_hash"]
    sets = ("--set", "tissue.materials.high.tissue.young=70 kPa", "--set", "tissue.materials.low.*.young=6 kPa")
    assert state(bin, scene, tmp_path, *sets)["state_hash"] == hard
    bad = text.replace("high.tissue: {young: 7 kPa, poisson: 0.3}", "high.tissue: {young: 7 kPa, poisson: 0.3, law: neo-hooke}")
    assert "neo-hooke" not in run(bin / "tm-sim", write(tmp_path / "law.yaml", bad), "--check", "--unset", "tissue.materials.high.tissue.law")[1]


def test_a_faulty_step_or_size_names_the_body(bin, block, tmp_path):
    scene = write(tmp_path / "two.yaml", HEAD % (TWO % (block, block), "low."))
    said = run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, "--set", "bodies.high.scale=0.5", "--set", "time.step=10 ms", code=2)[1]
    assert re.search(r"tetrahedron \d+ of body high, in its mesh file", said), said
    said = run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, "--set", "bodies.high.scale=1000")[1]
    assert "bodies.high.scale=1000: warning: body 'high' is 100 m across; if its file is in millimetres, write bodies.high.scale: 1" in said, said


STACK = """\
tissue:
  force: plain
  materials: {"*": {young: 5 kPa, poisson: 0.4}}
bodies:
  low: {mesh: %s}
  high: {mesh: %s, scale: 0.5, move: [20 mm, 20 mm, 51 mm]}
damping: {rate: 60 /s}
gravity:
energy:
supports: [{group: low.z_min}]
touch:
time: {frame_rate: 25 Hz, duration: 0.2 s}
"""


def test_a_body_falls_on_another_and_through_one_it_does_not_touch(bin, block, tmp_path):
    scene = write(tmp_path / "stack.yaml", STACK % (block, block))
    said, threads = state(bin, scene, tmp_path), state(bin, scene, tmp_path, "--set", "threads=2")
    assert said["state_hash"] == threads["state_hash"]
    assert said["energy"]["touch_J"] < 0 and abs(said["energy"]["residual_J"]) < 1e-12
    through = state(bin, scene, tmp_path, "--set", "touch.pairs=[{body: low, other: self}, {body: high, other: self}]")
    assert through["energy"]["touch_J"] == 0 and through["energy"]["gravity_J"] > said["energy"]["gravity_J"] + 0.01


def test_a_run_reports_the_force_between_bodies(bin, block, tmp_path):
    scene = write(tmp_path / "stack.yaml", STACK % (block, block))
    said = state(bin, scene, tmp_path, "--duration", "0.6")["touch"]
    weight_N = 9.81 * 1000 * 0.05 * 0.05 * 0.025
    assert said["rows"] > 10 and said["normal_sum_N"] == pytest.approx(weight_N, rel=0.02) and said["deepest_m"] < 1e-4 and not said["overflowed"]
    crowded = "--set", "touch.thickness=40 mm", "--duration", "0.04"
    assert "more surfaces were close than contact of tissue can list" in run(bin / "tm-sim", scene, "--lockstep", *crowded)[1]
    assert state(bin, scene, tmp_path, *crowded)["touch"]["overflowed"]


def test_bodies_that_overlap_at_rest_are_warned_of(bin, block, tmp_path):
    """The upper block has an edge of 50 mm: moved by 20 mm instead of 51 mm it lies in the lower one, and contact leaves it there."""
    scene = write(tmp_path / "stack.yaml", STACK % (block, block))

    def said(*changes):
        return run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, *(w for c in changes for w in ("--set", c)))[1]
    inside = "touch.pairs=[{body: low, other: high}]", "bodies.high.move=[20 mm, 20 mm, 20 mm]"
    assert re.search(r"move=.*: warning: 212 surface vertices of body 'high' are inside body 'low', up to [\d.]+ mm deep", said(*inside)), said(*inside)
    assert "inside body" not in said() and "inside body" not in said("bodies.high.move=[20 mm, 20 mm, 50 mm]")
    assert "inside body" not in said("touch.pairs=[{body: low, other: self}]", inside[1])
    # they have the same place; the surfaces coincide, which is no depth
    assert "inside body" not in said("bodies.high.scale=1", "bodies.high.move=[0, 0, 0]")


@pytest.mark.parametrize("change, words", [
    ("touch.pairs=[{body: low, other: middle}]", "there is no body 'middle'"),
    ("touch.friction={static: 0.1, kinetic: 0.2}", "kinetic 0.2 is above static 0.1"),
    ("model=precomputed", "touch and precomputed"),
    ("touch.thickness=0 mm", "outside"),
    ("touch.pairs=[]", "touch.pairs is empty; name two bodies, or leave it out"),
], ids=["no body", "friction", "precomputed", "thickness", "no pairs"])
def test_faulty_touch_is_refused(bin, block, tmp_path, change, words):
    text = (STACK % (block, block)).replace("gravity:\nenergy:\n", "") if "model" in change else STACK % (block, block)
    said = run(bin / "tm-sim", write(tmp_path / "bad.yaml", text), "--lockstep", "--frames", 1, "--set", change, code=2)[1]
    assert words in said and ";" in said, said


HUNG = """\
tissue:
  force: plain
  materials: {"*": {young: 5 kPa, poisson: 0.4}}
bodies:
  low: {mesh: %s, scale: 0.5, move: [20 mm, 20 mm, 0]}
  high: {mesh: %s, move: [0, 0, 30 mm]}
damping: {rate: 60 /s}
gravity:
energy:
supports: [{group: high.z_max}]
ties:
  between:
    - {from: low.z_max, to: high.z_min, stiffness: 30 N/m, break: 1 N, spacing: 12 mm}
time: {frame_rate: 25 Hz, duration: 0.4 s}
"""


def test_ties_hold_a_body_until_they_break(bin, block, types, tmp_path):
    scene = write(tmp_path / "hung.yaml", HUNG % (block, block))
    said, threads = state(bin, scene, tmp_path), state(bin, scene, tmp_path, "--set", "threads=2")
    assert said["state_hash"] == threads["state_hash"] and said["ties"]["whole"] > 4 and said["ties"]["gone"] == 0
    loose = state(bin, scene, tmp_path, "--set", "ties.between[0].break=1 mN", "--record", tmp_path / "log.lcm")
    assert loose["ties"] == {"whole": 0, "gone": said["ties"]["whole"]} and loose["energy"]["gravity_J"] > 2 * said["energy"]["gravity_J"]
    import lcm
    told = [types.cut_event_t.decode(e.data) for e in lcm.EventLog(str(tmp_path / "log.lcm"), "r") if e.channel == "CUT"]
    assert sorted(i for m in told for i in m.cut_tie) == list(range(said["ties"]["whole"]))
    assert all(m.instrument == -1 and m.removed_count == 0 and m.tie_count == len(m.cut_tie) > 0 for m in told)
    said = run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, "--set", "ties.between[0].within=1 mm", code=2)[1]
    assert "no vertex of 'low.z_max' on the surface is within 1 mm" in said


@pytest.mark.parametrize("change, words", [
    ("ties.between[0].spacing=0.1 mm", "a spacing of 0.1 mm leaves out no vertex of 'low.z_max': each has a tie"),
    ("ties.between[0].to=low", "'low.z_max' and 'low' have 64 surface vertices in common"),
], ids=["spacing", "one surface"])
def test_ties_that_are_hardly_meant_are_warned_of(bin, block, tmp_path, change, words):
    scene = write(tmp_path / "hung.yaml", HUNG % (block, block))
    warned = run(bin / "tm-sim", scene, "--lockstep", "--frames", 1, "--set", change)[1]
    assert (f"{change}: warning: {words}" if "spacing" in change else f"{scene}:13: warning: {words}") in warned, warned


def test_settling_states_what_ties_bear(bin, block, tmp_path):
    scene = write(tmp_path / "hung.yaml", HUNG % (block, block))
    said = report(bin / "tm-sim", scene, "--settle", "1e-8", "--set", "ties.between[0].break=0", tmp=tmp_path)["ties"]
    weight_N = 9.81 * 1000 * 0.05 * 0.05 * 0.025
    assert said["whole"] == 16 and said["gone"] == 0 and said["force_sum_N"] == pytest.approx(weight_N, rel=2e-3)
    assert said["force_sum_N"] / 16 < said["force_max_N"] < weight_N / 4
    assert "ties: 16 whole, 0 gone, forces of 0.61" in run(bin / "tm-sim", scene, "--settle", "1e-6")[0]


@pytest.mark.parametrize("ties", ["stiffness: 1000000 N/m", "stiffness: 1000 N/m, rest: 0"])
def test_ties_of_no_length_come_to_rest(bin, block, tmp_path, ties):
    """Blocks with a common face, or drawn together: across a short tie its force turns fast, and an explicit direction swung without end (1e-5 J)."""
    text = (STACK % (block, block)).replace("51 mm]", "50 mm]").replace("touch:\n", "ties: {between: [{from: high.z_min, to: low.z_max, spacing: 12 mm, %s}]}\n" % ties)
    said = state(bin, write(tmp_path / "glued.yaml", text), tmp_path, "--duration", "1.5")
    assert said["ties"]["whole"] == 16 and said["energy"]["kinetic_J"] < 1e-12 and abs(said["energy"]["residual_J"]) < 1e-12
    assert said["energy"]["touch_J"] < 0, "ties gained energy"


def test_ties_are_counted_before_and_after(bin, block, tmp_path):
    scene = write(tmp_path / "hung.yaml", HUNG % (block, block))
    assert "ties: 16\n" in run(bin / "tm-sim", scene, "--explain")[0]
    assert "gone" not in run(bin / "tm-sim", scene, "--lockstep", "--frames", 1)[0]
    load = "--set", "ties.between[0].break=1 mN"
    state(bin, scene, tmp_path, *load, "--snapshot-at", "0.2", "--snapshot", tmp_path / "a.snap")
    assert state(bin, scene, tmp_path, *load, "--restore", tmp_path / "a.snap")["ties"] == {"whole": 0, "gone": 16}
    broken = run(bin / "tm-sim", scene, "--lockstep", *load)[0]
    assert "ties: 0 whole, 16 gone, of these 16 at their breaking load" in broken


LEANING = """\
tissue:
  force: plain
  materials: {"*": {young: 5 kPa, poisson: 0.4}}
bodies:
  plate: {mesh: %s, scale: 0.5}
  low: {mesh: %s, scale: 0.5, move: [%s mm, 0, -25.6 mm]}
damping: {rate: 60 /s}
contact:
touch: {friction: {static: 0.3, kinetic: 0.3}}
supports: [{group: low.z_min}, {group: plate.x_min}]
instruments:
  - {mode: probe, radius: 4 mm, trocar: [25 mm, 25 mm, 180 mm]}
hand:
  - instrument: 0
    path:
      - {time: 0 s, tip: [22 mm, 24 mm, 29.5 mm]}
      - {time: 0.4 s, tip: [25 mm, 26 mm, 23 mm]}
      - {time: 0.8 s, tip: [28 mm, 25 mm, 24.5 mm]}
      - {time: 1.2 s, tip: [23 mm, 22 mm, 22.5 mm]}
haptics: {extrapolator: local_model, sends: patch, rate: 20 Hz, latency: 0}
time: {frame_rate: 20 Hz, duration: 1.2 s}
"""


def hand_errors(bin, tmp_path, scene, sources=("factor", "iterations")):
    """RMS errors of laws at 20 force samples a second, by source of the compliance, relative to the peak of the force of 500 a second."""
    import csv
    import math

    def forces(*changes):
        sets = [word for change in changes for word in ("--set", change)]
        run(bin / "tm-sim", scene, "--lockstep", "--quiet", "--record", tmp_path / "log.lcm", *sets)
        run(bin / "tm-evaluate", tmp_path / "log.lcm", "--forces", tmp_path / "forces.csv")
        with (tmp_path / "forces.csv").open() as file:
            return list(csv.DictReader(file))

    def vector(row, law):
        return [float(row[f"{law}_f{c}_N"]) for c in "xyz"]

    truth = {int(row["tool_us"]): vector(row, "hold") for row in forces("time.frame_rate=500 Hz", "haptics.rate=500 Hz", "haptics.extrapolator=hold", "haptics.sends=force")}
    peak = max(math.hypot(*f) for f in truth.values())
    errors = {}
    for source in sources:
        rows = [row for row in forces(f"haptics.compliance={source}") if int(row["tool_us"]) in truth]
        assert len(rows) > 500
        for law in ("local_model", "adaptive"):
            errors[source, law] = math.sqrt(sum(math.dist(vector(row, law), truth[int(row["tool_us"])])**2 for row in rows) / len(rows)) / peak
    return peak, errors


HELD_BY_TIES = """\
  frame: {mesh: %s, scale: 0.5, move: [60 mm, 0, 0], rigid: yes}
ties: {between: [{from: plate.x_max, to: frame.x_min, within: 30 mm, spacing: 12 mm, stiffness: 20 N/m, rest: 5 mm}]}
"""


def test_the_hand_feels_two_bodies_as_well_as_one(bin, block, tmp_path):
    """A plate that is held at one end: with the block away from it, resting against the block, tied to a frame; and one that only lies on the block."""
    scenes = {"alone": LEANING % (block, block, 200), "leaning": LEANING % (block, block, 0),
              "tied": (LEANING % (block, block, 200)).replace("damping:", HELD_BY_TIES % block + "damping:"),
              "lying": (LEANING % (block, block, 0)).replace(", {group: plate.x_min}", "").replace("contact:", "gravity:\ncontact:")}
    found = {name: hand_errors(bin, tmp_path, write(tmp_path / f"{name}.yaml", text), ("factor", "iterations") if name in ("alone", "leaning") else ("factor",))
             for name, text in scenes.items()}
    for name, (peak, errors) in found.items():
        print(f"{name}: {peak:.3f} N;", ", ".join(f"{source} {law} {100 * error:.2f} %" for (source, law), error in errors.items()))
    one_N, one = found["alone"]
    assert found["leaning"][0] > 1.3 * one_N and found["tied"][0] > 1.1 * one_N
    assert all(found["lying"][1]["factor", law] < one["factor", law] for law in ("local_model", "adaptive"))
    assert all(error < 2 * one[k] for name, (_, errors) in found.items() for k, error in errors.items())


def test_the_fine_cholecystectomy_is_written_for_real_time(root, build, tmp_path):
    """`make cholecystectomy FINE=1`: its line that writes the scene, run alone."""
    said = subprocess.run(["make", "-n", "cholecystectomy", "FINE=1", f"BUILD={build}", "config=release"], cwd=root, capture_output=True, text=True).stdout
    line = next(line for line in said.splitlines() if line.startswith("sed -e")).rsplit(" > ", 1)[0]
    scene = subprocess.run(["bash", "-ec", line], cwd=root, capture_output=True, text=True, check=True).stdout
    for words in ("threads: 2\ntissue:\n  precision: single\n", "step: 1 ms", "liver_18k.msh", "gallbladder_2k.msh", " 20,676 tetrahedra"):
        assert words in scene, words


def test_a_gallbladder_is_drawn_off_its_bed_and_its_ties_are_cut(bin, root, tmp_path):
    """The scene on a coarse liver and without rotation, to save time, until the first ties break."""
    said = state(bin, root / "apps/scenes/cholecystectomy.yaml", tmp_path, "--unset", "rotation", "--unset", "rendering", "--duration", "5",
                 "--set", f"bodies.liver.mesh={root}/meshes/liver_1k.msh", "--set", "energy=")
    assert said["ties"]["whole"] >= 10 and said["ties"]["gone"] >= 1 and [b["name"] for b in said["bodies"]] == ["liver", "gallbladder"]
    e = said["energy"]
    assert e["tool_work_J"][0] > 1e-3 and e["touch_J"] + e["touch_stored_J"] < 1e-3 * e["tool_work_J"][0] and abs(e["residual_J"]) < 1e-9


LIFT = """\
tissue:
  force: plain
  materials: {"soft.*": {young: 5 kPa, poisson: 0.4}}
bodies:
  table: {mesh: %s, rigid: yes, path: [{time: 0.1 s, move: [0, 0, 0]}, {time: 0.5 s, move: [0, 0, 20 mm]}]}
  soft: {mesh: %s, scale: 0.5, move: [20 mm, 20 mm, 51 mm]}
damping: {rate: 60 /s}
gravity:
energy:
touch:
contact:
cut:
instruments: [{mode: cautery, trocar: [10 mm, 10 mm, 250 mm]}]
hand: [{instrument: 0, path: [{time: 0 s, tip: [10 mm, 10 mm, 60 mm], active: yes}, {time: 0.1 s, tip: [10 mm, 10 mm, 50 mm], active: yes}]}]
time: {frame_rate: 25 Hz, duration: 0.8 s}
"""


def test_a_rigid_table_lifts_what_lies_on_it_and_is_not_cut(bin, block, tmp_path):
    scene = write(tmp_path / "lift.yaml", LIFT % (block, block))
    said = state(bin, scene, tmp_path)
    alone = state(bin, write(tmp_path / "soft.yaml", STACK % (block, block)), tmp_path, "--set", "bodies.low.scale=0.5")
    assert said["bodies"][0]["rigid"] is True and "rigid" not in said["bodies"][1] and said["dt_s"] == pytest.approx(alone["dt_s"], rel=0.05)
    table_N, weight_N = 9.81 * 1000 * 0.1 * 0.1 * 0.05, 9.81 * 1000 * 0.05 * 0.05 * 0.025
    # the block fell on the table and was lifted by it (20 mm, less about 0.5 mm of fall and the sag)
    assert -said["energy"]["gravity_J"] == pytest.approx(0.02 * table_N + 0.0192 * weight_N, abs=0.001 * weight_N) and abs(said["energy"]["residual_J"]) < 1e-10
    assert said["force_N"]["peak"] > 0.05 and said["tets_removed"] == 0  # the cautery pressed on the table
    # without a waypoint at time 0 it leaves its place smoothly, and does not jump to the first
    early = state(bin, scene, tmp_path, "--set", "bodies.table.path=[{time: 0.4 s, move: [0, 0, 10 mm]}]")
    later = state(bin, scene, tmp_path, "--set", "bodies.table.path=[{time: 0 s, move: [0, 0, 0]}, {time: 0.4 s, move: [0, 0, 10 mm]}]")
    assert early["state_hash"] == later["state_hash"]
    still = state(bin, scene, tmp_path, "--set", "bodies.table.path=[{time: 0 s, move: [0, 0, 0]}]")
    assert still["energy"]["gravity_J"] > 0 and still["tets_removed"] == 0


RIGID_PAIR = """\
tissue:
  force: plain
  materials: {"*": {young: 5 kPa, poisson: 0.4}}
bodies:
  table: {mesh: %s, rigid: yes}
  stand: {mesh: %s, scale: 0.5, rigid: yes, move: [0, 0, 52 mm], path: [{time: 0.1 s, move: [0, 0, -20 mm]}]}
  soft: {mesh: %s, scale: 0.5, move: [200 mm, 0, 0]}
damping: {rate: 60 /s}
energy:
supports: [{group: soft.z_min}]
touch:
ties: {between: [{from: soft.z_min, to: soft.z_max, within: 100 mm, stiffness: 1 N/m}]}
time: {frame_rate: 25 Hz, duration: 0.12 s}
"""


def test_rigid_bodies_pass_through_each_other_without_force(bin, block, tmp_path):
    scene = write(tmp_path / "rigid.yaml", RIGID_PAIR % (block, block, block))
    said = state(bin, scene, tmp_path)["energy"]
    assert all(abs(said[term]) < 1e-20 for term in ("touch_J", "touch_stored_J")), said


@pytest.mark.parametrize("change, words", [
    ("touch.pairs=[{body: table, other: stand}]", "bodies 'table' and 'stand' are both rigid and pass through each other; remove this pair"),
    ("touch.pairs=[{body: table, other: self}]", "body 'table' is rigid and never touches itself; remove this pair"),
    ("ties.between=[{from: table.z_max, to: stand.z_min, stiffness: 1 N/m}]", "'table.z_max' and 'stand.z_min' are both of rigid bodies, which ties cannot move"),
], ids=["pair", "self", "ties"])
def test_contact_and_ties_of_rigid_bodies_alone_are_warned_of(bin, block, tmp_path, change, words):
    scene = write(tmp_path / "pair.yaml", RIGID_PAIR % (block, block, block))
    warned = run(bin / "tm-sim", scene, "--check", "--set", change)[1]
    assert f"{change}: warning: {words}" in warned, warned
    assert "rigid" not in run(bin / "tm-sim", scene, "--check")[1]


@pytest.mark.parametrize("change, words", [
    ("bodies.soft.path=[{time: 0 s, move: [0, 0, 0]}]", "has a path and is not rigid"),
    ("bodies.table.path=[{time: 1 s, move: [0, 0, 0]}, {time: 1 s, move: [0, 0, 0]}]", "not later"),
    ("supports=[{group: table.z_min}]", "which is rigid"),
    ("bodies.table.path=[{time: 0 s, move: [0, 0, 1 mm]}]", "would jump to the first waypoint"),
    ("loads=[{group: table.z_max, total: [0, 0, -1 N]}]", "this load acts on the body 'table' alone, which is rigid"),
    ("loads=[{group: table.z_max, pressure: 1 kPa}]", "this load acts on the body 'table' alone, which is rigid"),
    ("bodies.soft.move=[1e9 m, 0, 0]", "body 'soft' would lie more than 100 km away"),
], ids=["not rigid", "order", "held", "jump", "load", "pressure", "far"])
def test_faulty_rigid_bodies_are_refused(bin, block, tmp_path, change, words):
    said = run(bin / "tm-sim", write(tmp_path / "bad.yaml", LIFT % (block, block)), "--lockstep", "--frames", 1, "--set", change, code=2)[1]
    assert words in said and ";" in said, said
