"""Makes the table, the CSV and the picture of `make compare`."""
import csv
import json
import pathlib

COLUMNS = ("program", "setting", "tets", "dt_s", "step_s", "per_second", "displacement_error", "force_error", "from_own", "force_from_own", "force_N", "prepare_s", "version",
           "differs", "kind", "why")
HEAD = f"{'program':10} {'setting':26} {'tets':>6} {'step':>8} {'a step':>9} {'a second':>9} {'u':>7} {'force':>7} {'u, own':>7} {'F, own':>7}  what differs"
LEGEND = """step: simulated, ms; a step: of processor, µs; a second: processor's seconds a simulated second (real time on a core: below 1)
u, force: error against the reference, displacements (all free vertices) and force on the press; u, own and F, own: against the linear law at rest on the same mesh"""


def processor():
    """Returns the processor's name."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return "unknown"
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")


def line(row):
    """Formats one row as text."""
    head = f"{row['program']:10} {row['setting']:26} {row['tets']:6}"
    if row["kind"] != "ran":
        return f"{head} {row['kind']}: {row['why']}"
    return (f"{head} {1e3 * row['dt_s']:8.3f} {1e6 * row['step_s']:9.1f} {row['per_second']:9.4f} {row['displacement_error']:7.1%} {row['force_error']:7.1%} "
            f"{row['from_own']:7.2%} {row['force_from_own']:7.2%}  {row['differs']}")


def text(found):
    """Formats the complete table."""
    said = [HEAD, *(line(row) for row in found["rows"]), LEGEND]
    reference = found.get("reference")
    if reference:
        near = reference["from_the_next"]
        said.append(f"reference: {reference['tets']} tetrahedra, press {reference['press']:.1%}, {reference['force_N']:.5f} N; the mesh before it is {near['displacement']:.1%} and "
                    f"{near['force']:.1%} off it")
    versions = sorted({f"{row['program']} {row['version']}" for row in found["rows"] if row.get("version")})
    lost = sorted({(row["program"], row["kind"], row["why"]) for row in found["rows"] if row["kind"] != "ran"})
    said += [", ".join(versions)] + [f"{program}: {kind}: {why}" for program, kind, why in lost]
    return "\n".join(said)


def draw(found, path):
    """Draws error against time: a line per setting, a point per mesh."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    ran = [row for row in found["rows"] if row["kind"] == "ran"]
    figure, axes = plt.subplots(1, 2, figsize=(11, 5), sharex=True)
    color = {"tensormass": "tab:red", "MuJoCo": "tab:blue", "Newton": "tab:green"}
    for axis, key, title in zip(axes, ("displacement_error", "force_error"), ("displacement", "force on the press")):
        used = {}
        for program, setting in dict.fromkeys((row["program"], row["setting"]) for row in ran):
            marker = used[program] = used.get(program, -1) + 1
            rows = [row for row in ran if (row["program"], row["setting"]) == (program, setting)]
            axis.loglog([row["per_second"] for row in rows], [row[key] for row in rows], color=color.get(program, "black"), marker="osD^v*"[marker % 6], markersize=5, linewidth=1,
                        linestyle=("-", "--", ":", "-.")[marker % 4], label=f"{program}: {setting}")
        axis.axvline(1, color="gray", linewidth=0.8)
        axis.set_xlabel("processor's seconds a simulated second")
        axis.set_ylabel(f"error of the {title}")
        axis.grid(alpha=0.3, which="both")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="lower center", ncol=3, fontsize=8)
    figure.subplots_adjust(left=0.08, right=0.98, top=0.97, bottom=0.27, wspace=0.22)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def write(found, out):
    """Writes compare.json, .csv and .png into the folder; returns the table."""
    out = pathlib.Path(out)
    (out / "compare.json").write_text(json.dumps(found, indent=1) + "\n")
    with open(out / "compare.csv", "w", newline="") as file:
        rows = csv.DictWriter(file, COLUMNS, restval="", extrasaction="ignore")
        rows.writeheader()
        rows.writerows(found["rows"])
    if any(row["kind"] == "ran" for row in found["rows"]):
        draw(found, out / "compare.png")
    return text(found)
