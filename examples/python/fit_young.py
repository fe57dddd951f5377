"""Fits Young's modulus to a measured force curve (columns depth_m, force_N; without a file, one made of 7.3 kPa with 2 % noise).

    python fit_young.py [PICTURE [CURVE.csv]]

The precomputed model gives a whole curve in milliseconds; a force grows with the modulus but for the skin of the tool, so a few rounds do.
"""
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import tensormass as tm

mesh = tm.Mesh.block((0.06, 0.06, 0.03), (8, 8, 4))
floor = mesh.near((0, 0, 0), (0, 0, 1))


def curve(young_Pa, depth_m):
    """Returns the force on a probe pressed to this depth, N."""
    model = tm.Model(mesh, tm.Material.young(young_Pa, 0.45), "precomputed", supports=[(floor, 0.0)], contact={"contact_compliance_m_N": 1e-4},
                     instruments=[tm.Instrument(trocar_m=(0.03, 0.03, 0.15), tip_m=(0.03, 0.03, 0.034))])
    return np.array([model.frame([tm.Pose((0.03, 0.03, 0.0325 - d))])[0].force_N[2] for d in depth_m])


if len(sys.argv) > 2:
    depth, measured = np.loadtxt(sys.argv[2], delimiter=",", skiprows=1, unpack=True)
else:
    depth = np.linspace(0.0005, 0.006, 23)
    measured = curve(7300.0, depth) * (1 + 0.02 * np.random.default_rng(1).standard_normal(len(depth)))

young, tried = 3000.0, []
for _ in range(6):
    force = curve(young, depth)
    tried.append((young, force))
    young *= (measured @ force) / (force @ force)

figure, axes = plt.subplots(figsize=(6, 4))
axes.plot(1e3 * depth, measured, "k.", label="measured")
for value, force in (tried[0], tried[-1]):
    axes.plot(1e3 * depth, force, label=f"E = {1e-3 * value:.2f} kPa")
axes.set(xlabel="depth, mm", ylabel="force, N", title=f"fitted in {len(tried)} rounds")
axes.legend()
axes.grid(alpha=0.3)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "fit_young.png", dpi=110, bbox_inches="tight")
print(f"E = {tried[-1][0]:.0f} Pa, residual {1e3 * np.sqrt(np.mean((tried[-1][1] - measured) ** 2)):.2f} mN RMS")
