"""Shared by the tests of tm-sim: running it (kit.py), the oracle's cases as files."""

import numpy as np
from kit import BLOCK, block_scene, report, run  # noqa: F401 (for the tests of this folder)


class Oracle:
    """Returns one file of tests/physics/oracle."""

    def __init__(self, path):
        words = iter(path.read_text().split())

        def numbers(n):
            return np.array([float(next(words)) for _ in range(n)])

        def expect(word):
            got = next(words)
            assert got == word, (got, word)

        expect("material"), setattr(self, "material", numbers(5))
        expect("engineering"), setattr(self, "engineering", numbers(5))
        expect("fibre"), setattr(self, "fibre", numbers(3))
        expect("gravity"), setattr(self, "gravity", numbers(4))
        expect("press"), setattr(self, "press", numbers(3))
        expect("poke"), setattr(self, "poke", numbers(4))
        self.clamp, self.tip, self.energy, self.u = {}, {}, {}, {}
        for case in ("gravity", "press", "poke"):
            expect(case)
            self.clamp[case], self.tip[case], self.energy[case] = numbers(3), numbers(3), numbers(1)[0]
        expect("vertices")
        n = int(next(words))
        self.vertex = numbers(3 * n).reshape(n, 3)
        expect("tets")
        t = int(next(words))
        self.tet = numbers(4 * t).astype(int).reshape(t, 4)
        for case in ("gravity", "press", "poke"):
            expect("displacements"), expect(case)
            self.u[case] = numbers(3 * n).reshape(n, 3)

    def write_mesh(self, path):
        lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(self.vertex))]
        lines += [f"{i + 1} {x:.17g} {y:.17g} {z:.17g}" for i, (x, y, z) in enumerate(self.vertex)]
        lines += ["$EndNodes", "$Elements", str(len(self.tet))]
        lines += [f"{i + 1} 4 2 1 1 {a + 1} {b + 1} {c + 1} {d + 1}" for i, (a, b, c, d) in enumerate(self.tet)]
        path.write_text("\n".join(lines + ["$EndElements", ""]))

    def scene(self, name, case, mesh):
        law = {
            "iso": "{young: 10 kPa, poisson: 0.45}",
            "fibre": "{lambda_T: %.17g, mu_T: %.17g Pa, lambda_L: %.17g, mu_L: %.17g}" % tuple(self.material[:4]),
            "muscle": "{E_L: %.17g, E_T: %.17g, nu_LT: %.17g, nu_TT: %.17g, G_L: %.17g}" % tuple(self.engineering),
        }[name]
        text = f"tissue:\n  mesh: {mesh}\n  materials:\n    \"*\": {law}\n"
        if name != "iso":
            text += "anisotropy: {rule: constant, direction: [%.17g, %.17g, %.17g]}\n" % tuple(self.fibre)
        text += "supports:\n  - {name: clamp, plane: {point: [0, 0, 0], normal: [1, 0, 0]}}\n"
        if case == "press":
            text += "  - {name: tip, plane: {point: [10 cm, 0, 0], normal: [1, 0, 0]}, displace: [%g, %g, %g]}\n" % tuple(self.press)
        if case == "gravity":
            text += "gravity: {acceleration: [%g, %g, %g]}\n" % tuple(self.gravity[1:])
        if case == "poke":
            text += "loads:\n  - {vertex: %d, force: [%g, %g, %g]}\n" % (self.poke[0], *self.poke[1:])
        return text
