"""Pages of `make evaluate`, `make accuracy` and `make stability`: captions agree with the figures, labels are readable, a phone shows the verdicts."""
import copy
import importlib.util
import re
import sys

import pytest


def load(root, folder, name):
    sys.path.insert(0, str(root / "apps/pages"))
    sys.path.append(str(root / "apps" / folder))  # a program's own folder is on its path
    spec = importlib.util.spec_from_file_location(name, root / "apps" / folder / "page.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def pages(root):
    return load(root, "pages", "page")


@pytest.fixture(scope="module")
def accuracy(root):
    return load(root, "studies/accuracy", "accuracy_page")


MESHES = [dict(law="isotropic", tets=t, h_m=h, step_s=h / 10, displacement=d, reaction=d / 2, wall_per_simulated=w) for t, h, d, w in ((162, 0.01, 0.7, 0.01), (1296, 0.005, 0.4, 0.2), (10368, 0.0025, 0.1, 4.0))]
STEPS = [dict(dt_s=1e-4 * k, of_guaranteed=0.1 * k, trajectory=0.001 * k * k, settle_s=0.29) for k in (1, 3, 9)]


def test_the_step_caption_follows_the_figures(accuracy):
    """The caption once said that the step's error is far below the mesh's, for any figures."""
    small, large, slow = (copy.deepcopy(STEPS) for _ in range(3))
    for r in small:
        r["trajectory"] /= 100
    for r in large:
        r["trajectory"] *= 3
    slow[2]["settle_s"] = 0.5
    assert "far less than the meshes' own" in accuracy.step_words(small, MESHES)
    assert "0.1 %" in accuracy.step_words(small, MESHES)
    assert ", less than the meshes' own" in accuracy.step_words(STEPS, MESHES)
    words = accuracy.step_words(large, MESHES)
    assert "24.3 %" in words and "not less than the meshes' own" in words and "from 0.30 of the guaranteed step down" in words
    assert "does not depend on the step" in words and "does not depend" not in accuracy.step_words(slow, MESHES)


def test_the_other_captions_follow_theirs(accuracy):
    assert "1,296 tetrahedra, 40.0 % off" in accuracy.mesh_words(MESHES) and "8.0 times the tetrahedra, 2.0 times the steps, 20 times the time" in accuracy.mesh_words(MESHES)
    assert "None of these meshes keeps real time" in accuracy.mesh_words([{**r, "wall_per_simulated": 3} for r in MESHES])
    rows = [dict(depth=d, displacement=u, reaction=f) for d, u, f in ((0.01, 0.05, 0.02), (0.1, 0.2, 0.12), (0.4, 0.5, 0.01))]
    alone = dict(displacement=0.04, reaction=0.01)
    assert "within 10 % up to a press of 1 %, forces up to 1 %" in accuracy.model_words(rows, alone)
    assert "more than 10 % at every depth" in accuracy.model_words(rows[1:], alone)
    kinds = [dict(precision=p, tets=10, displacement=e, mesh_displacement=0.1, bytes=b, seconds_per_step=s) for p, e, b, s in (("double", 0, 200, 1e-6), ("single", 1e-4, 100, 2e-6))]
    assert "1,000 times less" in accuracy.precision_words(kinds) and "is not faster" in accuracy.precision_words(kinds)
    rates = [dict(extrapolator=n, rate_Hz=r, rms=e) for n, r, e in (("hold", 20, 0.1), ("hold", 80, 0.02), ("local_model", 20, 0.03))]
    assert "needs 80 frames a second" in accuracy.rates_words(rates) and "even at 20" in accuracy.rates_words(rates[::2])
    fibres = [dict(seconds_per_step=s, bytes=b, displacement=u) for s, b, u in ((1.5, 120, 0.1), (1.0, 100, 0.6))]
    assert "price by +50 % and the tissue's memory by +20 %" in accuracy.fibre_words(fibres)


def test_tick_labels_never_overlap(pages):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(6, 2.5))
    axes[0][0].plot([1234.5, 1234.9], [0, 1])
    axes[0][1].plot([0.00101, 0.00129], [1, 2])
    axes[0][1].set_xscale("log")
    axes[0][2].semilogx([1e-9, 1e9], [1, 2])
    axes[1][0].loglog([10, 52], [3.1, 90])
    axes[1][1].plot([0, 1e6], [-1e6, 2e6])
    axes[1][2].set_xticks(range(40), [f"label {i}" for i in range(40)])
    assert pages.overlapping_ticks(figure)
    pages.thin_ticks(figure)
    assert not pages.overlapping_ticks(figure)
    assert all(len(pages._tick_labels(a.xaxis)) >= 2 for row in axes for a in row)
    plt.close(figure)


@pytest.fixture
def html(pages, tmp_path):
    page = pages.Page(tmp_path, "A page", "with two sections")
    page.section("First part")
    page.table("plain", ["a", "b"], [[1, 2]])
    page.section("Verdicts, many")
    page.table("verdicts", ["case", "what", "verdict"], [["one", "<b>", "broken"], ["two", "", "fine"]], mark=lambda row: "bad" if row[-1] == "broken" else "good")
    page.write("page")
    return (tmp_path / "index.html").read_text()


def test_contents_lead_to_the_sections(html):
    assert re.findall(r'<a href="#([^"]+)">', html) == re.findall(r'<h2 id="([^"]+)">', html) == ["first-part", "verdicts--many"]


def test_dark_and_narrow_screens(html):
    """On a phone a row of verdicts becomes a block that begins with its case and its verdict; every cell names its column."""
    style = re.search("<style>(.*?)</style>", html, re.S)[1]
    assert "prefers-color-scheme:dark" in style and "initial-scale=1" in html
    narrow = style[style.index("@media (max-width"):]
    assert ".verdicts td:last-child{order:-1" in narrow and ".verdicts tr{display:flex" in narrow
    rows = re.search("<table class=verdicts>.*?<tbody>(.*?)</tbody>", html, re.S)[1]
    assert re.findall('data-name="([^"]+)"', rows) == ["case", "what", "verdict"] * 2 and "&lt;b&gt;" in rows
    assert html.count("<script>") == 1 and "type='search'" in html
    assert "data-name" not in html[html.index("<table>"):html.index("</table>")]
