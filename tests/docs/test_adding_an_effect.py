"""docs/adding-an-effect.md shows the effect that is built: its code is the source's, but for line breaks."""
import re


def bare(text):
    return re.sub(r"\s+", "", text)


def test_the_page_shows_what_is_built(root):
    page = (root / "docs/adding-an-effect.md").read_text()
    sources = bare((root / "libtensormass/scene/effect_breathing.c").read_text()) + bare((root / "libtensormass/scene/effects.c").read_text())
    pieces = [p for block in re.findall(r"^```c\n(.*?)^```", page, re.M | re.S) for p in block.split("…") if p.strip()]
    assert len(pieces) >= 6
    for piece in pieces:
        assert bare(piece) in sources, f"the sources have no\n{piece}"


def test_what_it_names_is_there(root):
    page = (root / "docs/adding-an-effect.md").read_text()
    headers = "".join(p.read_text() for p in (root / "libtensormass/include/tensormass").glob("*.h"))
    for name in set(re.findall(r"\b(?:tm|TM)_[A-Za-z_0-9]+", page)):
        assert re.search(rf"\b{name}\b", headers), f"the library has no {name}"
