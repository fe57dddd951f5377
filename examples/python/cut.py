"""Draws a cautery across a stretched block, and plots the slit from above and the removed tetrahedra.

    python cut.py [PICTURE]"""
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import tensormass as tm

mesh = tm.Mesh.block((0.06, 0.06, 0.02), (16, 16, 5))
left, right = mesh.near((0, 0, 0), (1, 0, 0)), mesh.near((0.06, 0, 0), (1, 0, 0))
model = tm.Model(mesh, tm.Material.young(5e3, 0.4, density_kg_m3=1060, damping_1_s=60),
                 supports=[(left, (-0.004, 0, 0)), (right, (0.004, 0, 0))], cut={"rate_1_s": 2000},
                 instruments=[tm.Instrument(trocar_m=(0.03, 0.03, 0.15), tip_m=(0.03, 0.008, 0.024), mode="cautery", radius_m=0.0015, active=False)])
model.settle(1e-4)

way = np.linspace(0.008, 0.052, 60)
alive = [model.alive_count]
for y in way:
    model.frame([tm.Pose((0.03, y, 0.0185), active=True)])
    alive.append(model.alive_count)
model.settle(1e-4)  # the slit opens

figure, (above, count) = plt.subplots(1, 2, figsize=(10, 4.5))
position, triangles = 1e3 * model.position_m, model.surface.triangles
up = position[triangles].mean(1)[:, 2] > 5
above.tripcolor(position[:, 0], position[:, 1], triangles[up], facecolors=position[triangles[up]].mean(1)[:, 2], edgecolors="0.6", linewidth=0.2)
above.set(aspect="equal", xlabel="x, mm", ylabel="y, mm", title="the surface from above, by height")
count.plot(1e3 * np.concatenate([way[:1], way]), alive)
count.set(xlabel="the cautery's way, mm", ylabel="tetrahedra", title=f"{alive[0] - alive[-1]} of {alive[0]} removed")
count.grid(alpha=0.3)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "cut.png", dpi=110, bbox_inches="tight")
print(f"{alive[0] - alive[-1]} of {alive[0]} tetrahedra removed")
