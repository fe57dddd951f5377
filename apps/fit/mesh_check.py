"""The mesh's part in a fit: the fitted scene once more on a mesh with half the edges, and the constants and predictions without the mesh's error.

The error of linear tetrahedra falls with the square of their size. So the values of an infinitely fine mesh are those of the scene's mesh plus
(fine - scene's)/(1 - r^-2), r the ratio of the sizes (Richardson), and the constants follow by one Gauss-Newton step."""
import json
import pathlib
import re
import subprocess

import numpy as np
from model import Bad

EDGE = 0.88  # size for tm-mesh refine, of the cube of six mean tetrahedra: just above half of the longest edge of such a cube


def _value(text, section, key):
    """Returns the value of SECTION.KEY in a scene, or None."""
    block = re.search(rf"^{section}:(.*\n(?:[ \t#].*\n|\n)*)", text + "\n", re.M)
    found = block and re.search(rf"\b{key}:\s*[\"']?([^\"',}}\s]+)", re.sub(r"#.*", "", block[1]))
    return found and found[1]


def mesh_of(scene, sets):
    """Returns the path of the scene's mesh, metres per its unit, and the path of its tetrahedra's fibres or None (an image holds on every mesh)."""
    text = scene.read_text()
    changed = dict(s.split("=", 1) for s in sets if "=" in s)

    def value(section, key):
        return changed.get(f"{section}.{key}", _value(text, section, key))
    mesh, fibres = value("tissue", "mesh"), value("anisotropy", "file")
    if not mesh or re.search(r"^bodies:", text, re.M):
        raise Bad(f"--mesh-check: {scene} names no mesh under 'tissue', or has several; name one there, or compare two fits with meshes of your own")
    if fibres and fibres.endswith((".nii", ".nii.gz")):
        fibres = None
    return scene.parent / mesh, value("tissue", "scale") or "1", fibres and scene.parent / fibres


def check_loads(scene, row_sets):
    """A force acts on each selected vertex, and a finer mesh has more of them."""
    text = scene.read_text()
    loads = re.search(r"^loads:(.*\n(?:[ \t#-].*\n|\n)*)", text + "\n", re.M)
    if (loads and re.search(r"\bforce:", loads[1])) or any(re.match(r"loads\[\d+\]\.force", s) for s in row_sets):
        raise Bad(f"--mesh-check: {scene} has loads with 'force', which acts on each vertex, so that a finer mesh is loaded more; use 'total' or 'traction'")


def refine(mesh_tool, mesh, scale, fibres, out):
    """Writes the refined mesh, and fibres of its tetrahedra beside it. Returns both counts of tetrahedra and the ratio of the sizes."""
    def run(*words):
        done = subprocess.run([str(w) for w in (mesh_tool, *words)], capture_output=True, text=True)
        if done.returncode:
            raise Bad(f"--mesh-check: {done.stderr.strip() or done.stdout.strip()}")

    def info(path):
        run("info", "--scale", scale, "--json", out.with_suffix(".json"), path)
        return json.loads(out.with_suffix(".json").read_text())
    old = info(mesh)
    size = EDGE * (6 * old["volume_m3"] / old["tets"]) ** (1 / 3)
    box = ",".join(f"{v:.9g}" for v in (*(x - 1e-3 - size for x in old["low_m"]), *(x + 1e-3 + size for x in old["high_m"])))
    carried = ["--fibres", fibres, "--write-fibres", out.with_suffix(".csv")] if fibres else []
    run("refine", f"--box={box}", "--size", f"{size:.9g}", "--scale", scale, *carried, mesh, "-o", out)
    new = info(out)
    return old["tets"], new["tets"], (new["tets"] / old["tets"]) ** (1 / 3)


class MeshCheck:
    """The refined scene, and the constants without the mesh's error."""

    def __init__(self, mesh_tool, a, fine_trials):
        mesh, scale, fibres = mesh_of(a.scene, a.set)
        out = path_of(a.out).resolve()
        self.tets, self.refined, self.ratio = refine(mesh_tool, mesh, scale, fibres, out)
        self.trials = fine_trials([*a.set, f"tissue.mesh={out}", *([f"anisotropy.file={out.with_suffix('.csv')}"] if fibres else [])])

    def limit(self, problem, trials, x):
        """Returns the values of the scene's mesh, those without its error, and derivatives."""
        values, slopes = problem.at(trials, x)
        finer, _ = problem.at(self.trials, x, derivatives=False)
        return values, values + (finer - values) / (1 - self.ratio**-2), slopes

    def correct(self, problem, trials, x):
        """Sets the constants without the mesh's error, and each column's error of the mesh relative to the column's own size."""
        values, limit, slopes = self.limit(problem, trials, x)
        known, jacobian = problem.known, (slopes / problem.scale[..., None])[problem.known]
        step = np.linalg.lstsq(jacobian, ((values - limit) / problem.scale)[known], rcond=None)[0]
        low, high = ([c.inner(getattr(c, end)) for c in problem.constants] for end in ("low", "high"))
        self.x, self.start = np.clip(x + step, low, high), x
        size = [values[known[:, j], j] for j in range(known.shape[1])]
        self.error = [float(np.linalg.norm(limit[known[:, j], j] - s) / max(np.linalg.norm(s), 1e-300)) for j, s in enumerate(size)]

    def predicted(self, problem, trials):
        """Returns the values without the mesh's error, at the constants without it."""
        _, limit, slopes = self.limit(problem, trials, self.start)
        return limit + slopes @ (self.x - self.start)

    def found(self, problem):
        return {"tets": self.tets, "refined": self.refined, "error": self.error, "values": [c.outer(v) for c, v in zip(problem.constants, self.x)]}


def report(found):
    m = found["mesh_check"]
    print(f"mesh check: refined from {m['tets']:,} to {m['refined']:,} tetrahedra; the mesh's own error: " + ", ".join(f"{n} {100 * v:.1f} %" for n, v in zip(found["columns"], m["error"])))
    for c, value in zip(found["constants"], m["values"]):
        print(f"  without it: {c['path']} = {value:.5g}{' ' + c['unit'] if c['unit'] else ''} ({100 * (value / c['value'] - 1):+.1f} %)" if c["value"] else f"  without it: {c['path']} = {value:.5g}")
    if max(m["error"]) > 0.05:
        print("  the mesh errs by more than a twentieth: fit with a finer one")


def path_of(out):
    return pathlib.Path(out) / "mesh_check.msh"
