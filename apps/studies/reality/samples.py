"""Samples between grips or plates: strips of silicone pulled, cubes of brain pressed, pulled and sheared. Stress is force over the area at rest."""
from bodies import box, without_mesh_error, write_mesh
from trials import Trials

EDGE = 0.005  # m; stress does not depend on it
STRIP = """# Made by apps/studies/reality: an eighth of a strip that is pulled evenly.
tissue:
  mesh: strip.msh
  materials:
    "*": {{young: 100 kPa, poisson: 0.49, {law}, stretch: {stretch}}}
strain_smoothing:
supports:
  - {{name: x0, plane: {{point: [0, 0, 0], normal: [1, 0, 0]}}, axes: x}}
  - {{name: y0, plane: {{point: [0, 0, 0], normal: [0, 1, 0]}}, axes: y}}
  - {{name: z0, plane: {{point: [0, 0, 0], normal: [0, 0, 1]}}, axes: z}}
  - {{name: grip, plane: {{point: [0, 0, {edge}], normal: [0, 0, 1]}}, axes: z}}
"""
CUBE = """# Made by apps/studies/reality: a cube glued between plates.
tissue:
  mesh: cube_{cells}.msh
  materials:
    "*": {{young: 3 kPa, poisson: 0.49, {law}}}
strain_smoothing:
supports:
  - {{name: base, plane: {{point: [0, 0, 0], normal: [0, 0, 1]}}}}
  - {{name: plate, plane: {{point: [0, 0, {edge}], normal: [0, 0, 1]}}}}
"""
CELLS = (4, 6, 8)


def write_strip(folder, law, stretch=3.2, both=False):
    """Writes a strip with a grip along z, with `both` a sheet with one along x too. Returns the scene."""
    write_mesh(folder / "strip.msh", *box((1, 1, 1), (EDGE,) * 3))
    scene = folder / ("sheet.yaml" if both else "strip.yaml")
    scene.write_text(STRIP.format(law=law, stretch=stretch, edge=EDGE) + ("  - {name: side, plane: {point: [%g, 0, 0], normal: [1, 0, 0]}, axes: x}\n" % EDGE if both else ""))
    return scene


def strip(sim, folder, law, stretches, stretch=3.2, both=False, young_Pa=100e3):
    """Returns the stress, Pa, at each stretch."""
    found = []
    with Trials(sim, write_strip(folder, law, stretch, both), [f"tissue.materials.*.young={young_Pa:.9g}"]) as trials:
        for s in stretches:
            moves = [f"supports[3].displace=[0, 0, {EDGE * (s - 1):.9g}]", f"supports[4].displace=[{EDGE * (s - 1):.9g}, 0, 0]"][:1 + both]
            found.append(trials.ask(moves, settle=1e-9)["supports_N"][0][3][2] / EDGE**2)
    return found


def cube(sim, folder, law, moves, meshes=CELLS):
    """Returns the stress, Pa, along each move (strain along z, strain along x) of the plate, with three meshes without their error, for a Young's modulus of 3 kPa."""
    each = []
    for cells in meshes:
        write_mesh(folder / f"cube_{cells}.msh", *box((cells,) * 3, (EDGE,) * 3))
        (folder / "cube.yaml").write_text(CUBE.format(cells=cells, law=law, edge=EDGE))
        with Trials(sim, folder / "cube.yaml") as trials:
            found = []
            for along, across in moves:
                answer = trials.ask([f"supports[1].displace=[{EDGE * across:.9g}, 0, {EDGE * along:.9g}]"], settle=1e-8)
                found.append(answer["supports_N"][0][1][0 if across else 2] / EDGE**2)
            each.append(found)
    if len(meshes) == 1:
        return each[0]
    return [without_mesh_error([1 / c for c in CELLS], column)[0] for column in zip(*each)]
