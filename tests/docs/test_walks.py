"""docs/walks.md: each file that it names exists and is named once."""
import re


def test_the_walks_name_each_file_once(root):
    walks = (root / "docs/walks.md").read_text()
    assert walks.count("## A force, from the tensor to the motor") == walks.count("## An encoder count, to the capsule") == 1
    named = re.findall(r"`([a-z_]+/[a-z_/0-9]+\.[ch])`", walks)
    assert len(named) > 40
    for name in named:
        assert (root / name).is_file(), f"{name} is not there"
    twice = sorted({name for name in named if named.count(name) > 1})
    assert not twice, f"named twice: {twice}"


def test_the_glossary_is_in_order(root):
    """The glossary: each word once, ascending; each quoted name occurs in the sources."""
    page = (root / "docs/glossary.md").read_text()
    words = re.findall(r"^\| ([a-z' ]+) \|", page, re.M)[1:]
    assert len(words) > 25 and words == sorted(set(words), key=lambda w: w.replace("'", "")), [w for w, v in zip(words, sorted(words)) if w != v]
    sources = "".join(p.read_text() for folder in ("libtensormass", "haptic_rt", "apps", "lcm_types", "contact_law") for p in (root / folder).rglob("*.[ch]"))
    for name in set(re.findall(r"`((?:tm|tms|hrt|app|sim)_[a-z_]+|[A-Z]+_[A-Z_]+)`", page)):
        assert re.search(rf"\b{name}\b", sources), f"nothing is called {name}"
    for path in re.findall(r"`((?:haptic_rt|contact_law|lcm_types)/[a-z_/]+\.h)`", page):
        assert (root / path).is_file(), path
