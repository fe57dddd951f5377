"""The silicone beam: rest under its weight and a hung load, period and decrement about the rest, held to what was filmed.

The load hangs on the lower edge of the free end. Where the beam moves it has mass too: the row of cells at that edge and a row beyond it, whose centre is
the edge. A marker stands some 6 mm off the skin: its displacement is that of the nearest tetrahedron, extended.
"""
import numpy as np
from bodies import box, without_mesh_error, write_mesh
from scipy.optimize import brentq, least_squares
from swing import swing
from trials import Trials

MARKERS = ("m0", "m1", "m2")
AXIS = 2  # up
SCENE = """# Made by apps/studies/reality; the silicone beam, {what}.
title: The silicone beam, {what}
tissue:
  mesh: {mesh}
  materials:
    beam: {{young: 200 kPa, poisson: 0.499, density: {density} kg/m3}}
{hook}{law}gravity: {{acceleration: [0, 0, -{gravity}]}}
supports:
  - {{name: clamp, plane: {{point: [0, 0, 0], normal: [1, 0, 0]}}}}
time: {{frame_rate: 100 Hz}}
"""
SETTLE = 1e-7


def spectrum(time_s, share):
    """Returns three terms (time, s; share), each four times slower than the one before: the loss is flat over a decade, as that of silicone is."""
    return [(time_s / 4, share), (time_s, share), (4 * time_s, share)]


def mesh(path, size, across, hung):
    """Writes the beam with `across` cells across, and with `hung` a row of cells beyond the lower edge. Returns the hook's volume, m3."""
    along = round(across * size[0] / size[1])
    edge = size[0] / along
    vertex, tets = box((along, across, across), size)
    region = np.zeros(len(tets), int)
    if hung:
        longer, cells = box((along + 1, across, across), (size[0] + edge, *size[1:]))
        centre = longer[cells].mean(1)
        low, beyond = centre[:, 2] < size[2] / across, centre[:, 0] > size[0]
        keep = ~beyond | low
        used, cells = np.unique(cells[keep], return_inverse=True)
        vertex, tets = longer[used], cells.reshape(-1, 4)
        region = ((centre[keep, 0] > size[0] - edge) & low[keep]).astype(int)
    write_mesh(path, vertex, tets, region, ("beam", "hook")[:2 if hung else 1])
    return 2 * edge * size[1] * size[2] / across


class Beam:
    """Scenes of the beam by cells across and load; answers are means over `points`, m, up."""

    def __init__(self, sim, folder, measured, law="rotation:\nstrain_smoothing:\n", material=()):
        self.sim, self.folder, self.of, self.law = sim, folder, measured, law
        self.material = list(material)  # further settings of each region, as "law=neo-hooke"
        self.points = [measured["points_m"][m] for m in MARKERS]
        self.stiff = {}  # how much too stiff a mesh is

    def scene(self, across, load_N):
        name = f"beam_{across}_{load_N:g}"
        volume = mesh(self.folder / f"{name}.msh", self.of["size_m"], across, load_N > 0)
        density = self.of["authors"]["density_kg_m3"]
        inside, hung = density * volume / 2, load_N / self.of["gravity_m_s2"]
        hook = f"    hook: {{young: 200 kPa, poisson: 0.499, density: {(hung + inside) / volume:.9g} kg/m3}}\n" if load_N > 0 else ""
        text = SCENE.format(what=f"{load_N:g} N hung on it, {across} cells across", mesh=f"{name}.msh", density=density, hook=hook, law=self.law, gravity=self.of["gravity_m_s2"])
        (self.folder / f"{name}.yaml").write_text(text)
        return self.folder / f"{name}.yaml", ("beam", "hook") if hook else ("beam",)

    def ask(self, across, load_N, young_Pa, poisson, more=(), **what):
        scene, regions = self.scene(across, load_N)
        words = [f"tissue.materials.{r}.{w}" for r in regions for w in (f"young={young_Pa:.9g}", f"poisson={poisson}", *self.material)]
        with Trials(self.sim, scene) as trials:
            return trials.ask([*words, *more], points_m=self.points, **what)

    def rest(self, load_N, young_Pa, poisson, meshes):
        """Returns how far the three markers hang, mm, without the mesh's error, and on each mesh."""
        each = [[-1e3 * p[AXIS] for p in self.ask(n, load_N, young_Pa, poisson, settle=SETTLE)["points_m"][0]] for n in meshes]
        mean = [float(np.mean(e)) for e in each]
        converged, _ = without_mesh_error([1 / n for n in meshes], mean)
        for n, m in zip(meshes, mean):
            self.stiff[n] = converged / m
        return [converged * x / mean[-1] for x in each[-1]], mean

    def swings(self, load_N, young_Pa, poisson, across, terms=(), seconds=2.0):
        """Returns (period, s; decrement) of m1 after it is let go straight; the mesh's excess of stiffness is taken off its Young's modulus."""
        words = [f"viscosity.terms=[{', '.join(f'{{time: {t:.6g} s, shear: {g:.6g}}}' for t, g in terms)}]"] if terms else []
        left = 1 - sum(g for _, g in terms)
        answer = self.ask(across, load_N, young_Pa / left / self.stiff[across], poisson, words, duration_s=seconds)
        return swing(answer["time_s"], [p[1][AXIS] for p in answer["points_m"]])

    def fit_rest(self, apart_mm, poisson, meshes, low_Pa=1.2e5, high_Pa=5e5):
        """Returns the Young's modulus, Pa, at which the load pulls the mean of the markers so far from their rest under weight."""
        def lack(young_Pa):
            loaded, weight = (np.mean(self.rest(load, young_Pa, poisson, meshes)[0]) for load in (self.of["load_N"], 0.0))
            return loaded - weight - apart_mm
        return float(brentq(lack, low_Pa, high_Pa, rtol=2e-3))

    def fit_swing(self, load_N, young_Pa, poisson, across, period_s, decrement, seconds=2.0):
        """Returns the (time, s; share) of the spectrum with which the beam of this relaxed modulus has this period and decrement."""
        def lack(p):
            found = self.swings(load_N, young_Pa, poisson, across, spectrum(np.exp(p[0]), p[1]), seconds)
            return [10 * (found[0] / period_s - 1), found[1] / decrement - 1]
        best = least_squares(lack, [np.log(0.03), 0.1], bounds=([np.log(0.002), 0.005], [np.log(0.5), 0.3]), diff_step=0.05, xtol=3e-3, ftol=1e-4, max_nfev=8)
        return float(np.exp(best.x[0])), float(best.x[1])
