"""`bodies.NAME.effects` in tm-sim: the same bits as at the top level, what is told, and what is refused."""
import pytest
from simkit import report, run

EFFECTS = {"rotation": "{threshold: 0.03}", "strain_smoothing": "{shear_share: 0.2}", "viscosity": "{terms: [{time: 0.05 s, shear: 0.3}]}"}
SCENE = """\
tissue:
  force: plain
  materials: {"*": {young: 5 kPa, poisson: 0.4}}
bodies:
  left: {mesh: %(mesh)s%(left)s}
  right: {mesh: %(mesh)s, move: [300 mm, 0, 0]%(right)s}
  table: {mesh: %(mesh)s, move: [0, 300 mm, 0], rigid: yes%(table)s}
%(top)s
damping: {rate: 60 /s}
gravity:
energy:
supports: [{group: left.x_min}, {group: right.x_min}]
time: {frame_rate: 25 Hz, duration: 0.12 s}
"""


def own(*names):
    return ", effects: {%s}" % ", ".join(n if ":" in n else f"{n}: {EFFECTS[n]}" for n in names) if names else ""


def scene(path, root, left=(), right=(), table=(), top=""):
    path.write_text(SCENE % {"mesh": root / "meshes/block_1k.msh", "left": own(*left), "right": own(*right), "table": own(*table), "top": top})
    return path


@pytest.mark.parametrize("names", [("rotation",), ("strain_smoothing",), ("rotation", "viscosity")], ids="-".join)
def test_effects_of_all_bodies_have_the_bits_of_the_top_level(bin, root, tmp_path, names):
    top = scene(tmp_path / "top.yaml", root, top="\n".join(f"{n}: {EFFECTS[n]}" for n in names))
    all = scene(tmp_path / "all.yaml", root, names, names)
    one = scene(tmp_path / "one.yaml", root, names)
    top, all, one, threads = (report(bin / "tm-sim", s, "--lockstep", *args, tmp=tmp_path)
                              for s, args in ((top, ()), (all, ()), (one, ()), (one, ("--set", "threads=2"))))
    assert top["state_hash"] == all["state_hash"] != one["state_hash"] == threads["state_hash"]
    assert [b.get("effects") for b in one["bodies"]] == [sorted(names), None, None] and "effects" not in top["bodies"][0]
    assert abs(one["energy"]["residual_J"]) < 1e-6


def test_explain_names_the_effects_of_a_body(bin, root, tmp_path):
    said = run(bin / "tm-sim", scene(tmp_path / "s.yaml", root, ("rotation",), ("rotation", "viscosity")), "--explain")[0]
    assert "effects of its own: rotation\n" in said and "effects of its own: rotation, viscosity\n" in said


LAW = ("5 kPa, poisson: 0.4", "5 kPa, poisson: 0.4, law: neo-hooke")


@pytest.mark.parametrize("bodies, change, line, words", [
    ({"left": ["gravity: "]}, (), 5, "gravity cannot differ between bodies"),
    ({"left": ["spin: "]}, (), 5, "unknown key 'spin' in bodies.left.effects"),
    ({"left": ["rotation: {threshold: 7}"]}, (), 5, "bodies.left.effects.rotation.threshold = 7 is outside"),
    ({"table": ["rotation"]}, (), 7, "body 'table' is rigid"),
    ({"left": ["rotation"], "top": "rotation:"}, (), 5, "rotation already applies to all bodies, as the top level names it"),
    ({"left": ["rotation"], "right": ["rotation: {threshold: 0.05}"]}, (), 6, "rotation has other values in body 'left'"),
    ({"left": ["viscosity"], "right": ["viscosity: {terms: [{time: 0.05 s, shear: 0.3, bulk: 0.3}]}"]}, (), 6, "viscosity has other values"),
    ({"left": ["rotation", "strain_smoothing: "]}, (), 5, "strain_smoothing and rotation act in one body, and strain_smoothing in some bodies only"),
    ({"left": ["rotation", "viscosity"], "right": ["viscosity"]}, (), 5, "one stage keeps one kind of history"),
    ({"left": ["viscosity"]}, LAW, 5, "viscosity of some bodies and a nonlinear law"),
    ({"left": ["strain_smoothing: "]}, LAW, 5, "strain_smoothing of some bodies and a nonlinear law"),
    ({"left": ["rotation"]}, LAW, 3, "law 'neo-hooke' and rotation exclude each other"),
], ids=["other effect", "unknown", "range", "rigid", "twice", "threshold", "terms", "averages", "histories", "law viscosity", "law averages", "law"])
def test_faulty_effects_of_bodies_are_refused_with_their_line(bin, root, tmp_path, bodies, change, line, words):
    path = scene(tmp_path / "bad.yaml", root, **bodies)
    path.write_text(path.read_text().replace(*change)) if change else None
    said = run(bin / "tm-sim", path, "--lockstep", "--frames", 1, code=2)[1]
    assert said.startswith(f"{path}:{line}: ") and words in said and ";" in said, said
