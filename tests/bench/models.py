#!/usr/bin/env python3
"""Measures what the models cost on a scene, with patches for its controllers: computing seconds of the complete path in lockstep, interleaved, least
of several, as a table.

python tests/bench/models.py [SCENE] [--runs 5] [--duration "8 s"] [--bin build/bin]"""
import argparse
import json
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
MODELS = ("dynamic", "hybrid", "precomputed")


def compute_s(tm_sim, scene, model, more):
    run = subprocess.run([tm_sim, scene, "--lockstep", "--quiet", "--set", f"model={model}", *more, "--json", "-"], cwd=ROOT, capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"{scene} with model={model}: {run.stderr.strip()}")
    return json.loads(run.stdout)["compute_s"]


def measure(tm_sim, scene, runs, duration):
    """Returns the least computing seconds by model, with haptics as in the scene and without. Runs are interleaved, so slow periods of the machine
    affect all alike."""
    length = ["--duration", duration] if duration else []
    least = {}
    for _ in range(runs):
        for model in MODELS:
            for felt in (True, False):
                s = compute_s(tm_sim, scene, model, [*length, *([] if felt else ["--unset", "haptics"])])
                least[model, felt] = min(s, least.get((model, felt), s))
    return least


def table(least):
    lines = ["| model | with patches, s | over dynamic | without haptics, s | over dynamic | patches, s |", "|---|---|---|---|---|---|"]
    for model in MODELS:
        felt, bare = least[model, True], least[model, False]
        lines.append(f"| {model} | {felt:.3g} | {felt / least['dynamic', True]:.3g} | {bare:.3g} | {bare / least['dynamic', False]:.3g} | {felt - bare:.3g} |")
    return "\n".join(lines)


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("scene", nargs="?", default="apps/scenes/liver-press.yaml")
    p.add_argument("--runs", type=int, default=5)
    p.add_argument("--duration", help="of the path [the scene's]")
    p.add_argument("--bin", default=str(ROOT / "build/bin"))
    a = p.parse_args()
    print(table(measure(pathlib.Path(a.bin) / "tm-sim", a.scene, a.runs, a.duration)))


if __name__ == "__main__":
    main()
