"""Presses a block of liver-like tissue with a probe and plots force over depth, going in and coming back.

    python press.py [PICTURE]
"""
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import tensormass as tm

mesh = tm.Mesh.block((0.06, 0.06, 0.03), (10, 10, 5))
model = tm.Model(mesh, tm.Material.young(5e3, 0.45, density_kg_m3=1060, damping_1_s=40), supports=[(mesh.near((0, 0, 0), (0, 0, 1)), 0.0)],
                 instruments=[tm.Instrument(trocar_m=(0.03, 0.03, 0.15), tip_m=(0.03, 0.03, 0.034))], frame_s=1 / 30)

top = 0.03 + 0.0025  # the block's surface and the probe's radius: where they touch
way = np.concatenate([np.linspace(0.034, 0.0265, 60), np.linspace(0.0265, 0.034, 60)])
reactions = [model.frame([tm.Pose((0.03, 0.03, z))])[0] for z in way]
depth = 1e3 * np.array([top - r.tip_m[2] for r in reactions])  # the mean over the frame, like the force
force = np.array([r.force_N[2] for r in reactions])

figure, axes = plt.subplots(figsize=(6, 4))
axes.plot(depth[:60], force[:60], label="in")
axes.plot(depth[60:], force[60:], label="back", linestyle="--")
axes.set(xlabel="depth, mm", ylabel="force on the probe, N", title=f"{mesh.tet_count} tetrahedra, {model.timing.substeps} substeps a frame")
axes.legend()
axes.grid(alpha=0.3)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "press.png", dpi=110, bbox_inches="tight")
print(f"peak {force.max():.3f} N at {depth.max():.1f} mm; {1e3 * abs(model.u_m).max():.2f} mm left after")
