"""The short form of `make accuracy`: orders, monotone frontiers, completeness. Never times."""
import json
import math
import subprocess
import sys

import pytest


@pytest.fixture(scope="module")
def page(bin, root, once):
    def make(out):
        figures = out / "figures.json"
        subprocess.run([bin / "tm-accuracy", "--quick", "--json", figures], cwd=root, check=True, timeout=600)
        subprocess.run([sys.executable, root / "apps/studies/accuracy/page.py", figures, "-o", out], check=True, timeout=900)

    out = once("accuracy", make)
    return out, json.loads((out / "accuracy.json").read_text())


def test_every_knob_has_its_figure_table_and_numbers(page):
    out, data = page
    html = (out / "index.html").read_text()
    for knob in ("mesh", "strain_smoothing", "step", "mass", "precision", "model", "law", "viscosity", "friction", "fibre"):
        assert data[knob]["rows"], knob
        assert (out / f"{knob}.csv").read_text().count("\n") > len(data[knob]["rows"]), knob
        assert (out / f"{knob}.png").stat().st_size > 5000, knob
        assert f'alt="{knob}"' in html, knob
    assert "http" not in html.replace("http-equiv", ""), "the page is not self-contained"
    assert data["bandwidth_B_s"] > 0
    assert all(data["circumstances"][k] != "unknown" for k in ("machine", "compiler", "flags"))


@pytest.mark.parametrize("law", ["isotropic", "fibred"])
def test_finer_meshes_are_better(page, law):
    rows = [r for r in page[1]["mesh"]["rows"] if r["law"] == law]
    for key in ("displacement", "reaction"):
        errors = [r[key] for r in rows]
        assert errors == sorted(errors, reverse=True), (key, errors)
    orders = page[1]["mesh"]["orders"][law]
    assert orders["displacement"][-1] > 0.8
    assert orders["reaction"][-1] > 1.5


def test_no_mesh_is_dominated(page):
    """Each finer mesh is more accurate and costlier, so all are on the frontier. Costs are tetrahedra times steps, not seconds."""
    rows = [r for r in page[1]["mesh"]["rows"] if r["law"] == "isotropic"]
    price = [r["tets"] / r["step_s"] for r in rows]
    assert price == sorted(price)
    assert all(a["displacement"] > b["displacement"] for a, b in zip(rows, rows[1:]))


def test_strain_smoothing_does_not_lock_and_is_more_accurate_on_every_mesh(page):
    """Strain smoothing has at most half the error of linear tetrahedra from the second mesh on, with a longer step; a beam bends correctly up to nu =
    0.499."""
    rows, beams = page[1]["strain_smoothing"]["rows"], page[1]["strain_smoothing"]["cantilever"]
    for linear in (r for r in rows if r["form"] == "linear"):
        own = {r["shear"]: r for r in rows if r["form"] == "strain_smoothing" and r["tets"] == linear["tets"]}
        assert sorted(own) == [0.4, 0.75, 1]
        for r in own.values():
            assert r["displacement"] < (0.65 if linear["tets"] < 1000 else 0.5) * linear["displacement"], r
            assert 1.25 * linear["step_s"] < r["step_s"] <= r["sharp_s"], r
    assert beams[-1]["nu"] >= 0.499 and beams[-1]["linear"] < 0.1
    for beam in beams:
        assert beam["nu"] > 0.4995 or abs(beam["shear_1"] - 1) < 0.08, beam
        assert beam["linear"] < beam["shear_0.4"] < beam["shear_0.75"] < beam["shear_1"], beam


def test_step_error_is_second_order_and_rest_does_not_depend_on_it(page):
    step = page[1]["step"]
    for key in ("trajectory", "phase", "energy"):
        assert 1.8 < step["orders"][key] < 2.3, (key, step["orders"][key])
    settle = [r["settle_s"] for r in step["rows"]]
    assert max(settle) / min(settle) < 1.02
    assert step["guaranteed_s"] <= step["sharp_s"]


def test_mass_scaling_gives_cuttable_tissue_its_step(page):
    """Mass scaling adds nothing up to three times the step; beyond it the added mass grows, and the frequency falls by no more than that explains."""
    rows = page[1]["mass"]["rows"]
    assert [r["scaled"] for r in rows] == [False] + [True] * 5
    added = [r["added"] for r in rows]
    assert added == sorted(added) and added[2] < 1e-3 < added[-1]
    for r in rows:
        assert (1 + 2 * r["added"]) ** -0.5 - 1e-9 <= r["frequency"] <= 1
        assert r["held_force"] < 0.01 and r["force"] < (2e-3 if r["added"] < 1e-3 else 0.05), r


def test_single_tensors_cost_seven_digits_and_half_the_bytes(page):
    rows = page[1]["precision"]["rows"]
    for double, single in zip(rows[::2], rows[1::2]):
        assert double["displacement"] == 0
        assert 0 < single["displacement"] < 1e-5
        assert single["bytes"] < 0.7 * double["bytes"]


def test_linear_tissue_is_worse_the_deeper_it_is_pressed(page):
    rows = page[1]["model"]["rows"]
    assert [r["depth"] for r in rows][0] == pytest.approx(0.01) and rows[-1]["depth"] == pytest.approx(0.4)
    errors = [r["displacement"] for r in rows]
    assert errors == sorted(errors)


def test_the_three_models_agree_at_rest_and_have_their_prices(page):
    prices = page[1]["model"]["prices"]
    assert [p["model"] for p in prices] == ["tensor/mass", "hybrid", "precomputed"]
    for p in prices:
        assert p["difference"] < 1e-4, p
        assert p["seconds_per_frame"] > 0 and p["bytes"] > 0


def test_each_law_is_that_of_an_independent_code_to_40_percent(page):
    """On the mesh of reference/laws.json: to rounding where no tetrahedron is beyond a limit of its law. Where one is, this coarse mesh's force is within 5 % (docs/which-law.md has the finer one, within 3 %) and the shape within 1.2 times the mesh's own error."""
    rows = page[1]["law"]["verification"]
    assert len({r["law"] for r in rows}) == 6 and {r["case"] for r in rows} == {"press", "shear", "twist", "bend", "indent"} and len(rows) == 6 * 7
    for r in rows:
        assert r["shape_off"] < 1.2 * r["mesh_shape_off"], r
        assert r["force_off"] < 0.05 and r["energy_off"] < 0.03 and r["limited_share"] < 0.03, r
        if not r["limited_share"]:
            assert r["force_off"] < 1e-5 and r["energy_off"] < 1e-5 and abs(r["shape_off"] / r["mesh_shape_off"] - 1) < 1e-3, r
    assert sum(not r["limited_share"] for r in rows) > len(rows) / 2
    assert any(r["mesh_force_off"] > 0.05 for r in rows), "the mesh's own error is far larger"


def test_holzapfel_sheared_by_40_percent_stays_within_its_default_limits(bin, root, tmp_path):
    """On the mesh of 10,368 tetrahedra, as docs/which-law.md states: with one limit of 1.6 for strain and fibres the force is 7 % off."""
    sys.path[:0] = [str(root / f) for f in ("apps/fit", "apps/studies/reality", "apps/studies/accuracy/reference")]
    import bodies
    import law_cases
    import law_solver
    from trials import Trials
    block = law_solver.Block(law_cases.CUBE, law_cases.MESHES["ten"][0], 1)
    bodies.write_mesh(tmp_path / "block.msh", block.rest, block.tet)
    (tmp_path / "shear.yaml").write_text("""title: A block sheared by 40 %
tissue: {mesh: block.msh, materials: {"*": {young: 5 kPa, poisson: 0.45, law: holzapfel, k1: 4 kPa, k2: 0.8, dispersion: 0.1}}}
anisotropy: {rule: constant, direction: [0.6, 0, 0.8]}
supports:
  - {name: base, plane: {point: [0, 0, 0], normal: [0, 0, 1]}}
  - {name: top, plane: {point: [0, 0, 30 mm], normal: [0, 0, 1]}, displace: [12 mm, 0, 0]}
""")
    with Trials(bin / "tm-sim", tmp_path / "shear.yaml") as trials:
        force = trials.ask(settle=1e-8)["supports_N"][0][1][0]
    truth, = (r["ten"][0]["force"] for r in json.loads((root / "apps/studies/accuracy/reference/laws.json").read_text())["rows"] if (r["case"], r["law"]) == ("shear", "holzapfel"))
    assert abs(force / truth - 1) < 1e-5


def test_the_laws_references_are_those_of_their_solver(root):
    """One case of laws.json, solved again: what is committed is what law_solver.py finds."""
    sys.path.insert(0, str(root / "apps/studies/accuracy/reference"))
    import law_cases
    for law in ("neo-hooke", "fung, fibred"):
        committed, = (r["small"] for r in json.loads((root / "apps/studies/accuracy/reference/laws.json").read_text())["rows"] if (r["case"], r["law"]) == ("shear", law))
        (_, force, energy, _), = law_cases.solve("shear", law, "small")
        assert force == pytest.approx(committed[0]["force"], rel=1e-6) and energy == pytest.approx(committed[0]["energy_J"], rel=1e-6)


def test_linear_tissue_in_place_of_a_law_is_worse_the_deeper_it_is_pressed(page):
    for law in {r["truth"] for r in page[1]["law"]["rows"]}:
        own = [r for r in page[1]["law"]["rows"] if r["truth"] == law]
        shapes = [r["displacement"] for r in own if r["form"] == "linear"]
        assert shapes == sorted(shapes) and len(shapes) >= 2
        for r in (r for r in own if r["form"] == "law"):
            assert r["same_mesh_reaction"] < 0.05, r
    prices = page[1]["law"]["price"]
    assert prices[0]["form"] == "linear" and prices[0]["price_ratio"] == 1 and len(prices) == 9
    assert all(0 < p["step_ratio"] <= 1 and p["ns_per_tet"] > 0 for p in prices)


def test_omitting_fibres_errs_more_than_the_mesh(page):
    rows = page[1]["fibre"]["rows"]
    assert rows[0]["model"] == "fibred"
    assert all(r["displacement"] > 1.5 * rows[0]["displacement"] for r in rows[1:])


@pytest.mark.parametrize("arguments, says", [
    (["--knob", "nonsense", "--json", "x.json"], "parameter 'nonsense' does not exist"),
    (["--quick"], "--json FILE is missing"),
    (["--bad"], "unknown option, or its value is missing"),
    (["--reference", "nowhere.json", "--json", "x.json"], "nowhere.json"),
    (["--json", "no/such/folder/x.json", "--quick", "--knob", "precision"], "no/such/folder"),
])
def test_invalid_options_are_rejected(bin, root, tmp_path, arguments, says):
    if "--reference" not in arguments:
        arguments = [*arguments, "--reference", root / "apps/studies/accuracy/reference/reference.json"]
    run = subprocess.run([bin / "tm-accuracy", *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=400)
    assert run.returncode == 2, run
    assert says in run.stderr
    assert not list(tmp_path.iterdir())


def test_rotation_is_nearer_the_nonlinear_reference(page):
    """Displacements agree with neo-Hooke and St. Venant-Kirchhoff within 1.5 times the mesh's own error; with strain smoothing, which lowers that
    error, within two thirds of it."""
    data = page[1]["rotation"]
    rows = {volume: {(r["law"], r["depth"]): r for r in data["rows"] if r["volume"] == volume} for volume in (False, True)}
    assert {law for law, _ in rows[False]} == {"neo", "svk"} and max(depth for _, depth in rows[False]) == pytest.approx(0.4)
    assert rows[True].keys() == rows[False].keys() and data["mesh_alone_volume"] < 0.6 * data["mesh_alone"]
    for own, volume in (("mesh_alone", False), ("mesh_alone_volume", True)):
        for case, r in rows[volume].items():
            assert r["displacement"] < 1.5 * data[own], r
            assert r["displacement"] < r["linear_displacement"], r
            assert r["displacement"] <= (2 / 3 if volume else 1) * rows[False][case]["displacement"], r
    assert 0.8 < data["price"]["step_ratio"] < 1


def test_viscosity_is_of_second_order_at_fast_strains_and_alike_shares_cost_no_second_pass(page):
    data = page[1]["viscosity"]
    errors = [r["modulus"] for r in data["rows"]]
    ratios = [(a["steps_a_cycle"], b["steps_a_cycle"], a["modulus"] / b["modulus"]) for a, b in zip(data["rows"], data["rows"][1:])]
    assert errors == sorted(errors, reverse=True) and errors[-1] < 1e-4
    assert all(0.8 * (m / n)**2 < r < 1.2 * (m / n)**2 for n, m, r in ratios[1:]), ratios
    assert [(p["terms"], p["shares"]) for p in data["price"]] == [(0, "none"), (1, "alike"), (3, "alike"), (1, "shear"), (3, "shear")]


def test_a_ramp_and_hold_of_liver_follows_the_closed_form(page):
    out, data = page
    data = data["viscosity"]["ramp"]
    shares, times = [t["shear"] for t in data["terms"]], [t["time_s"] for t in data["terms"]]
    assert data["worst"] < 1e-10
    for r in data["rows"]:
        t, ramp = r["time_s"], min(r["time_s"], data["ramp_s"])
        left = (1 - sum(shares)) * ramp + sum(g * tau * (math.exp((ramp - t) / tau) - math.exp(-t / tau)) for g, tau in zip(shares, times))
        assert r["stress_Pa"] == pytest.approx(3 * data["sudden_shear_Pa"] * data["strain"] / data["ramp_s"] * left, rel=1e-9)
    stress = [r["stress_Pa"] for r in data["rows"]]
    top = stress.index(max(stress))
    assert abs(math.log(data["rows"][top]["time_s"] / data["ramp_s"])) < 0.2, "the peak is where the ramp ends"
    assert stress == sorted(stress[:top]) + sorted(stress[top:], reverse=True) and stress[-1] < 0.2 * stress[top]
    assert (out / "viscosity_ramp.png").stat().st_size > 5000 and "VIVA+" in (out / "index.html").read_text()


def test_friction_is_most_of_the_force_along_a_slide_and_obeys_coulomb(page):
    rows = page[1]["friction"]["rows"]
    assert [(r["at_rest"], r["sliding"]) for r in rows] == [(0, 0), (0.05, 0.05), (0.1, 0.1), (0.3, 0.2), (0.3, 0.3), (0.5, 0.5)]
    assert rows[0]["slipped"] == 0 and abs(rows[0]["along_N"]) < 0.02 * rows[0]["normal_force_N"]
    for less, r in zip(rows, rows[1:]):
        assert r["along"] > 0.8 and r["along"] > less["along"] and r["force"] > less["force"], r
        assert r["slipped"] > 50 and r["off_law"] < 1e-6, r
        assert abs(r["along_N"] / r["normal_force_N"] - r["sliding"]) < 0.02, r  # the surface below the tool is slightly inclined
