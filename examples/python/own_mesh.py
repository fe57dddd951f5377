"""A mesh of your own, from arrays: a twisted bar that hangs by one end, at rest and swinging. With meshio installed, any file that it reads:

    python own_mesh.py [PICTURE [MESH_FILE]]
"""
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import tensormass as tm

if len(sys.argv) > 2:
    import meshio

    read = meshio.read(sys.argv[2])
    points, tets = read.points, read.cells_dict["tetra"]
else:
    straight = tm.Mesh.block((0.01, 0.01, 0.08), (3, 3, 24), origin_m=(-0.005, -0.005, 0))
    angle = np.pi * straight.rest_m[:, 2] / 0.08
    x, y, z = straight.rest_m.T
    points = np.column_stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z])
    tets = straight.tets

mesh = tm.Mesh(points, tets, orient=True)  # (V, 3) m and (T, 4); copied
tissue = tm.Tissue(mesh, tm.Material.young(250e3, 0.4, density_kg_m3=1060, damping_1_s=8))
world = tm.World(tissue)
world.add_support(np.flatnonzero(mesh.rest_m[:, 2] < mesh.rest_m[:, 2].min() + 1e-6))
world.add_gravity((9.81, 0, 0))
rest = world.settle(1e-8)
still = world.position_m
world.u_m[:] = 0  # released from the straight bar
world.u_prev_m[:] = 0
tip = int(mesh.rest_m[:, 2].argmax())
time, swing = [], []
while world.time_s < 1.0:
    world.step(20)
    time.append(world.time_s)
    swing.append(1e3 * world.u_m[tip, 0])

figure = plt.figure(figsize=(11, 4.5))
solid = figure.add_subplot(1, 2, 1, projection="3d")
solid.plot_trisurf(*(1e3 * still).T, triangles=tissue.surface.triangles, color="salmon", edgecolor="0.4", linewidth=0.2)
solid.set(xlabel="x, mm", zlabel="z, mm", yticks=[], title="at rest under its weight, which acts along x")
solid.set_box_aspect(np.ptp(still, axis=0))
graph = figure.add_subplot(1, 2, 2)
graph.plot(time, swing)
graph.axhline(1e3 * (still - mesh.rest_m)[tip, 0], color="0.5", linestyle=":", label="at rest")
graph.set(xlabel="time, s", ylabel="the tip's x, mm", title=f"{len(tets)} tetrahedra, step {1e6 * world.dt_s:.0f} us")
graph.legend()
figure.subplots_adjust(wspace=0.35)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "own_mesh.png", dpi=110, bbox_inches="tight")
print(f"sags {1e3 * (still - mesh.rest_m)[tip, 0]:.2f} mm; settled in {rest.steps} steps; swings to {max(swing):.2f} mm")
