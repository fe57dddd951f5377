"""docs/adding-an-effect.md shows the effect that is built: the code equals the source except for line breaks."""
import re

from kit import effects


def bare(text):
    return re.sub(r"\s+", "", text)


def test_the_page_shows_what_is_built(root):
    page = (root / "docs/adding-an-effect.md").read_text()
    sources = bare((root / "libtensormass/scene/effect_breathing.c").read_text()) + bare((root / "libtensormass/scene/effects.c").read_text())
    pieces = [p for block in re.findall(r"^```c\n(.*?)^```", page, re.M | re.S) for p in block.split("…") if p.strip()]
    assert len(pieces) >= 6
    for piece in pieces:
        assert bare(piece) in sources, f"the sources have no\n{piece}"


def test_names_on_the_page_exist(root):
    page = (root / "docs/adding-an-effect.md").read_text()
    headers = "".join(p.read_text() for folder in ("include/tensormass", "numeric")
                      for p in (root / "libtensormass" / folder).glob("*.h"))
    for name in set(re.findall(r"\b(?:tm|TM)_[A-Za-z_0-9]+", page)):
        assert re.search(rf"\b{name}\b", headers), f"the library has no {name}"


def sources(root):
    """Returns (name, text) of the library, the programs and the Python package, except an effect's own file and the table."""
    for folder in ("libtensormass", "apps", "haptic_rt", "lcm_types", "python"):
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".c", ".h", ".cpp", ".py") and not re.match(r"effects?[_.]", path.name):
                yield path.relative_to(root).as_posix(), path.read_text(errors="replace")


def lists(text):
    """Returns statements that name three effects or more as strings."""
    names = {e.name for e in effects()}
    found = ({*re.findall(r"\"(\w+)\"", statement)} & names for statement in text.split(";"))
    return [sorted(named) for named in found if len(named) > 2]


def test_no_list_of_effects_is_kept_by_hand(root):
    """Code that loops over effects uses the library's table. The core has members of definitions; studies concern some effects, each in a row of its
    own."""
    own = ("libtensormass/src/model", "apps/studies/accuracy/main.c", "apps/studies/accuracy/page", "apps/studies/stability/page.py", "apps/studies/evaluate/")
    phases = "const char *const phase_name[PHASE_COUNT] = {"  # phases of a session: three have an effect's name
    kept = {name: lists("".join(line for line in text.splitlines(True) if not line.startswith(phases))) for name, text in sources(root)}
    assert not {name: found for name, found in kept.items() if found and not name.startswith(own)}
    assert lists('static const char *const never[] = {"contact", "strain_smoothing", "haptics"};') == [["contact", "haptics", "strain_smoothing"]]


def test_an_effect_is_known_by_its_own_file_alone(root):
    """The page's example: nothing else in library, programs or Python names it."""
    assert not [name for name, text in sources(root) if '"breathing"' in text]
    own = (root / "libtensormass/scene/effect_breathing.c").read_text()
    assert '.name = "breathing"' in own and ".example = " in own
