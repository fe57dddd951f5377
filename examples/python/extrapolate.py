"""Tries extrapolators on a log: between the samples of a simulation a controller must guess; here it guesses the samples that came next.

    tm-sim SCENE.yaml --lockstep --record press.log
    python extrapolate.py press.log [PICTURE]
"""
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import tensormass as tm

log = tm.read_log(sys.argv[1])
samples, status = log["FORCE_0"], log["SIM_STATUS"]
trocar = status["trocar_m"][0][0]
used = samples["tool_utime"] > 0  # since the controller was first received
t_us, tip, force = samples["tool_utime"][used], samples["tip_m"][used], samples["force_N"][used]
stiffness, kind = samples["stiffness_N_m"][used], samples["stiffness_kind"][used]

figure, axes = plt.subplots(figsize=(8, 4))
seconds = 1e-6 * (t_us - t_us[0])
axes.plot(seconds, np.linalg.norm(force, axis=1), "k", label="the simulation")
errors = {}
for name in ("hold", "position", "tangent"):
    law = tm.Extrapolator(name)
    guessed = np.zeros_like(force)
    for i in range(len(t_us) - 1):
        told = tm.Reaction(seconds[i], tip[i], force[i], force[i], stiffness[i].reshape(3, 3), int(kind[i]), 1, 0)
        law.take(tm.sample(told, int(t_us[i]), trocar, seq=i))
        guessed[i + 1] = law.force(int(t_us[i + 1]), tip[i + 1] - trocar)
    miss = np.linalg.norm(guessed - force, axis=1)[1:]
    errors[name] = 100 * np.sqrt(np.mean(miss**2)) / np.linalg.norm(force, axis=1).max()
    axes.plot(seconds[1:], np.linalg.norm(guessed, axis=1)[1:], ".", markersize=3, label=f"{name}: {errors[name]:.2f} % of the peak RMS")
axes.set(xlabel="time, s", ylabel="force, N", title="each sample guessed from the one before")
axes.legend()
axes.grid(alpha=0.3)
figure.savefig(sys.argv[2] if len(sys.argv) > 2 else "extrapolate.png", dpi=110, bbox_inches="tight")
print(", ".join(f"{name} {error:.2f} %" for name, error in errors.items()))
