"""docs/tutorial, typed as a reader types it: each chapter in a folder that looks like the source tree, its output compared with the page. `make
demo`, the first command, is run by tests/view/test_session.py (its driver) and completely by CI."""
import re
import sys

import pytest
from paths import ROOT

sys.path.insert(0, str(ROOT / "tools/pictures"))
import tutorial  # noqa: E402

CHAPTERS = tutorial.chapters()


@pytest.mark.parametrize("number", [*range(1, 6), pytest.param(6, marks=pytest.mark.clock), *range(7, 10)])
def test_chapter_shows_the_real_output(build, tmp_path, number):
    page = CHAPTERS[number - 1]
    if number == 7 and not (build / "lib/tensormass/image.so").exists():
        pytest.skip("no module 'image' in this build")
    missing = tutorial.follow(page, tmp_path / "tree", build)
    assert not missing, "\n".join(missing)
    drawn, _ = tutorial.picture(page)
    assert number in (1, 9) or (tmp_path / "tree" / drawn).read_bytes()[:4] == b"\x89PNG"


def test_nine_short_chapters_front_to_back(root):
    assert [page.name[0] for page in CHAPTERS] == list("123456789")
    for page, following in zip(CHAPTERS, [*CHAPTERS[1:], None]):
        text = page.read_text()
        assert text.startswith(f"# {page.name[0]}. ") and len(text.split()) < 500, page.name
        assert len(re.findall(r"^!\[", text, re.M)) == 1, f"{page.name}: one picture"
        assert any(kind == "type" for kind, _ in tutorial.steps(page))
        assert not following or f"\nNext: [{following.read_text().split(chr(10))[0][2:].split(':')[0]}" in text, page.name


@pytest.mark.parametrize("expected, line, same", [
    ("a …; peak 2.02 N", "a 1 b; peak 2.04 N", True), ("a …; peak 2.02 N", "a 1 b; peak 2.2 N", False), ("peak 2.02 N", "peak two N", False), ("2/6 scene …", "2/6 scene", True), ("2/6 scene", "2/6 scenes", False),
    ('"tets": 20,', '\t"tets":\t20,', True), ("1,2e-3", "1,2.01e-3", True), ("1,2e-3", "1,3e-3", False)])
def test_changed_output_is_detected(expected, line, same):
    assert tutorial.shows(expected, line) == same
