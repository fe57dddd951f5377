"""Result pages open with a plot, are short, and name the commands of their figures; their plots are drawn from their own tables."""
import re
import subprocess
import sys

import pytest

RESULTS = ("accuracy", "stability", "performance", "extrapolation", "reality")
# Words of a page at most; pages that are not named: DEFAULT. A longer page is split into how-to, reference and explanation (tools/site/index.md).
DEFAULT = 1000
MOST = {"README": 400, "controller": 2200, "troubleshooting": 1500, "contact": 1500, "viewing": 900, "compared": 900, "installing": 700, "fuzzing": 500, "glossary": 600, "style": 500,
        **dict.fromkeys(("bodies", "corotation", "dedicated-machine", "devices", "extrapolators", "friction", "hybrid", "messages", "passivity", "viscosity", "your-own-organ"), 1500)}
GENERATED = {"scene-reference"}


def words(text):
    """Words with a letter or digit: bars of tables and marks of lists are none."""
    return sum(bool(re.search(r"\w", word)) for word in text.split())


def test_no_page_is_too_long(root):
    pages = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    found = {page.stem: words(page.read_text()) for page in pages}
    long = [f"{name}: {count} words, at most {MOST.get(name, DEFAULT)}" for name, count in found.items() if name not in GENERATED and count > MOST.get(name, DEFAULT)]
    assert len(found) > 70 and set(MOST) <= set(found) and not long, "\n".join(long)


def test_a_long_page_would_be_seen():
    assert words("| a | b |\n|---|---|\n- two words, `code`") == 5


@pytest.mark.parametrize("name", RESULTS)
def test_result_pages_are_short_and_open_with_a_plot(root, name):
    page = (root / f"docs/{name}.md").read_text()
    assert len(page.split()) < 900, f"{len(page.split())} words: move what is history to notes/"
    plot, table = page.index("\n!["), page.index("\n|")
    assert page.index("\n    ") < plot < table, "command, plot, table come in this order"
    assert len(page[:plot].split()) < 80 and page[plot:table].count("\n#") < 2, "the first screen shows the plot and one table"
    assert len(re.findall(r"\]\(\.\./notes/", page)) == 1, "notes are linked once"
    assert "not in the tree" not in page, "a figure has a command in the tree"


def test_plots_equal_their_tables(root, tmp_path):
    """A changed table without its plot fails: tools/pictures/plots.py draws it again."""
    subprocess.run([sys.executable, root / "tools/pictures/plots.py", tmp_path], check=True, timeout=120)
    drawn = sorted(p.name for p in tmp_path.iterdir())
    assert drawn == ["extrapolation-operating.svg", "performance-step.svg", "reality-differences.svg", "stability-outcomes.svg", "which-law.svg"]
    for name in drawn:
        assert (tmp_path / name).read_bytes() == (root / "docs/images" / name).read_bytes(), f"{name}: run tools/pictures/plots.py"


def test_every_hard_case_is_in_the_plot(root):
    sys.path.insert(0, str(root / "tools/pictures"))
    import plots
    assert sum(sum(g.values()) for g in plots.outcomes().values()) == int(re.search(r"`make stability` runs (\d+) hard cases", (root / "docs/stability.md").read_text())[1])
