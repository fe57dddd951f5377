"""Section on nonlinear laws in the accuracy report. page.py calls it, after it has put the module `page` on the path.

`python page_laws.py FIGURES.json` prints the tables of docs/which-law.md, from `tm-accuracy --knob law --json FIGURES.json`."""
import json
import pathlib
import sys

FORMS = ("linear", "rotation", "rotation, strain_smoothing", "law", "law, strain_smoothing")


def percent(value):
    """Formats a share: three digits above a thousandth, else an upper bound."""
    return f"{100 * value:.2g} %" if value >= 1e-5 else "< 0.001 %"


def worst(data, key):
    """Returns the largest figure, with the larger limit where tetrahedra are beyond the default one."""
    return max(r[key] for r in data["verification"] if r["stretch"] > 1.6 or not r["limited_share"])


def words(data):
    """Describes the agreement on the same mesh, and where linear tissue differs most."""
    ratio = max(r["shape_off"] / r["mesh_shape_off"] for r in data["verification"])
    deepest = [r for r in data["rows"] if r["form"] == "linear" and r["depth"] == 0.4]
    most = max(deepest, key=lambda r: r["same_mesh_reaction"])
    return (f"On the same mesh, with <code>stretch</code> 2 where tetrahedra pass 1.6, the force is at most {percent(worst(data, 'force_off'))} from the independent solution (energy {percent(worst(data, 'energy_off'))}), "
            f"and the shape's error at most {ratio:.2f} times the mesh's own. Linear tissue in place of a law errs most for {most['truth']}: {percent(most['same_mesh_reaction'])} of the force at 40 %.")


def laws(page, data):
    """Adds the section on nonlinear laws: error of linear tissue by depth, verification, and price."""
    import matplotlib.pyplot as plt
    from page import label_line, series
    page.section("Nonlinear laws", "Blocks pressed, sheared, twisted, bent and indented by up to 40 % under each <code>law</code>, against Newton's method of an independent code "
                 "(<code>reference/law_solver.py</code>, which agrees with CalculiX to 4e-7) on the same mesh and on a fine one of ten-node tetrahedra.")
    figure, axis = plt.subplots()
    rows = [r for r in data["rows"] if r["truth"] == "neo-hooke"]
    for j, form in enumerate(FORMS):
        own = [r for r in rows if r["form"] == form]
        axis.plot([100 * r["depth"] for r in own], [100 * r["displacement"] for r in own], **series(j))
        label_line(axis, 100 * own[-1]["depth"], 100 * own[-1]["displacement"], form, series(j))
    axis.set(xlabel="indented by % of the tissue's size", ylabel="displacement error, %", ylim=(0, None))
    page.figure("law", figure, words(data), "tm-accuracy --knob law")
    page.table("law", ["truth", "form", "indented %", "displacement", "reaction", "energy", "reaction, same mesh"],
               [[r["truth"], r["form"], 100 * r["depth"], r["displacement"], r["reaction"], r["energy"], r["same_mesh_reaction"]] for r in data["rows"]],
               "Truth: the law on the fine mesh; in the last column the law on the form's own mesh, which leaves the mesh's error out.")
    page.table("law_verification", ["case", "law", "stretch", "level %", "tets", "force", "off, same mesh", "the mesh's own", "energy off, same mesh", "shape off", "the mesh's own", "beyond a limit"],
               [[r["case"], r["law"], r["stretch"], 100 * r["level"], r["tets"], r["force"], r["force_off"], r["mesh_force_off"], r["energy_off"], r["shape_off"], r["mesh_shape_off"], r["limited_share"]]
                for r in data["verification"]], "Force in N, of the twist in N m.")
    page.table("law_price", ["form", "ns a tetrahedron and step", "step s", "step over linear", "price of a simulated second over linear", "step over linear, stretch 2"],
               [[r["form"], r["ns_per_tet"], r["step_s"], r["step_ratio"], r["price_ratio"], r.get("far_step_ratio", "")] for r in data["price"]])
    page.record("law", data)


def markdown(head, rows):
    print("\n| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(row) + " |")


def tables(data):
    """Prints the figures of docs/which-law.md."""
    price = {r["form"]: r for r in data["price"]}
    of = {(r["truth"], r["form"], r["depth"]): r for r in data["rows"]}
    names = list(dict.fromkeys(r["truth"] for r in data["rows"]))
    depths = sorted({r["depth"] for r in data["rows"]})
    def three(key, truth, form):
        return [f"{100 * of[truth, form, d][key]:.1f} %" for d in depths]

    markdown(["law", *(f"linear, {100 * d:.0f} %" for d in depths), *(f"`rotation`, {100 * d:.0f} %" for d in depths), "step", "price", "step, `stretch: 2`"],
             [[f"`{n}`", *three("same_mesh_reaction", n, "linear"), *three("same_mesh_reaction", n, "rotation"), f"× {price[n]['step_ratio']:.2f}", f"× {price[n]['price_ratio']:.1f}", f"× {price[n]['far_step_ratio']:.2f}"] for n in names])
    markdown(["computed as", *(f"shape, {100 * d:.0f} %" for d in depths), *(f"force, {100 * d:.0f} %" for d in depths)],
             [[f, *three("displacement", "neo-hooke", f), *three("reaction", "neo-hooke", f)] for f in FORMS])
    rows = []
    for case in dict.fromkeys(r["case"] for r in data["verification"]):
        for level in sorted({r["level"] for r in data["verification"] if r["case"] == case}):
            both = [r for r in data["verification"] if (r["case"], r["level"]) == (case, level)]
            own = [r for r in both if r["stretch"] > 1.6 or not r["limited_share"]]
            rows.append([f"{case}, {100 * level:.0f} %", f"{own[0]['tets']:,}", percent(max(r["force_off"] for r in both if r["stretch"] < 2)), percent(max(r["force_off"] for r in own)), percent(max(r["energy_off"] for r in own)),
                         f"{100 * min(r['mesh_force_off'] for r in own):.1f} to {100 * max(r['mesh_force_off'] for r in own):.1f} %",
                         f"{max(r['shape_off'] / r['mesh_shape_off'] for r in own):.3f}", percent(max(r["limited_share"] for r in own))])
    markdown(["case", "tetrahedra", "force, most, default limit", "force, most", "energy, most", "the mesh's own force", "shape over the mesh's own, most", "beyond a limit, most"], rows)
    markdown(["beyond a limit of the law", "`stretch`", "tetrahedra beyond", "force from the fine mesh's: library", "independent code, same mesh"],
             [[f"{r['law']}, {r['case']}, {100 * r['level']:.0f} %", f"{r['stretch']:g}", f"{100 * r['limited_share']:.1f} %", percent(r["fine_force_off"]), percent(r["mesh_force_off"])]
              for r in data["verification"] if r["limited_share"]])
    print("\nprice, ns a tetrahedron and step: " + ", ".join(f"{r['form']} {r['ns_per_tet']:.1f}" for r in data["price"]))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: page_laws.py FIGURES.json")
    tables(json.loads(pathlib.Path(sys.argv[1]).read_text())["law"])
