"""Compares two runs of the benchmark: `compare.py OLD.json NEW.json`.

Each ratio is within one run, whose parts were interleaved, so that different or busy machines compare. Exit 1: a ratio has become a tenth slower."""
import json
import sys

WORSE = 1.1


def ratios(figures):
    """Returns whether smaller is better, by the figure's name."""
    least = {(r["tets"], r["precision"], r["form"]): r["us_per_pass"]["min"] for r in figures["force"]}
    yardstick = "naive" if any(form == "naive" for _, _, form in least) else "plain"  # older files have no naive loop
    found = {f"force, {tets} tetrahedra, {precision}: best over {yardstick} double": us / least[tets, "double", yardstick]
             for (tets, precision, form), us in least.items() if form == "best"}
    for row in figures["step"]:
        found[f"step, {row['tets']} tetrahedra, over a force pass"] = row["step_over_force"]
        found[f"step, {row['tets']} tetrahedra, divided over whole, {row['threads']} threads"] = 1 / row["speedup"]
    for row in figures.get("numbering", []):
        found[f"numbering, {row['tets']} tetrahedra, {row['precision']}: shuffled over ordered"] = row["shuffled_over_ordered"]
        if "renumbered_over_ordered" in row:
            found[f"numbering, {row['tets']} tetrahedra, {row['precision']}: renumbered over ordered"] = row["renumbered_over_ordered"]
    for row in figures.get("law", []):
        found[f"law {row['law']}, {row['tets']} tetrahedra: step over linear"] = row["over_linear"]
    for row in figures.get("touch", []):
        found[f"touch, {row['tets']} tetrahedra, {row['rows']} rows: over without"] = row["over_without"]
    for row in figures.get("hybrid", []):
        found[f"hybrid, {row['tets']} tetrahedra, {row['share']:.3f} tensor/mass: over a dynamic frame"] = row["hybrid_over_dynamic"]
    return found


def main():
    old, new = (ratios(json.load(open(path))) for path in sys.argv[1:3])
    slower = 0
    for name in new:
        if name not in old:
            continue
        worse = new[name] > WORSE * old[name]
        slower += worse
        print(f"{name}: {old[name]:.3f} -> {new[name]:.3f}{'  slower' if worse else ''}")
    return 1 if slower else 0


if __name__ == "__main__":
    sys.exit(main())
