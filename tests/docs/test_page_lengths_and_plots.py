"""Result pages open with a plot, are short, and name the commands of their figures; their plots are drawn from their own tables."""
import re
import subprocess
import sys

import pytest

RESULTS = ("accuracy", "stability", "performance", "extrapolation", "reality")


@pytest.mark.parametrize("name", RESULTS)
def test_result_pages_are_short_and_open_with_a_plot(root, name):
    page = (root / f"docs/{name}.md").read_text()
    assert len(page.split()) < 900, f"{len(page.split())} words: move what is history to notes/"
    plot, table = page.index("\n!["), page.index("\n|")
    assert page.index("\n    ") < plot < table, "command, plot, table come in this order"
    assert len(page[:plot].split()) < 80 and page[plot:table].count("\n#") < 2, "the first screen shows the plot and one table"
    assert len(re.findall(r"\]\(\.\./notes/", page)) == 1, "notes are linked once"
    assert "not in the tree" not in page, "a figure has a command in the tree"


def test_plots_are_of_the_tables(root, tmp_path):
    """A changed table without its plot fails: tools/pictures/plots.py draws it again."""
    subprocess.run([sys.executable, root / "tools/pictures/plots.py", tmp_path], check=True, timeout=120)
    drawn = sorted(p.name for p in tmp_path.iterdir())
    assert drawn == ["extrapolation-operating.svg", "performance-step.svg", "reality-differences.svg", "stability-outcomes.svg"]
    for name in drawn:
        assert (tmp_path / name).read_bytes() == (root / "docs/images" / name).read_bytes(), f"{name}: run tools/pictures/plots.py"


def test_every_hard_case_is_in_the_plot(root):
    sys.path.insert(0, str(root / "tools/pictures"))
    import plots
    assert sum(sum(g.values()) for g in plots.outcomes().values()) == int(re.search(r"`make stability` runs (\d+) hard cases", (root / "docs/stability.md").read_text())[1])
