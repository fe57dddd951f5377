"""Pages as the site shows them: one top heading each, pictures on a white ground, comments of headers in the right place, no dead link."""
import html
import os
import re
import subprocess
import urllib.parse

import pytest


def pages(root):
    return [root / "README.md", root / "tools/site/index.md", *sorted((root / "docs").rglob("*.md"))]


def test_a_page_has_one_top_heading(root):
    """The sidebar lists top headings: a second one would appear as a page of its own."""
    for page in pages(root):
        text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
        heads = re.findall(r"^# .*$", text, re.M)
        assert len(heads) == 1 and text.lstrip().startswith(heads[0]), f"{page.name}: {heads}"


def test_headings_do_not_skip_a_level(root):
    for page in pages(root):
        text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
        levels = [len(h) for h in re.findall(r"^(#+) ", text, re.M)]
        assert all(b <= a + 1 for a, b in zip(levels, levels[1:])), f"{page.name}: {levels}"


def test_pictures_have_a_white_ground(root):
    """Dark lines on a transparent ground would be invisible in the dark theme."""
    images = pytest.importorskip("PIL.Image")
    seen = 0
    for path in sorted((root / "docs/images").iterdir()):
        seen += 1
        if path.suffix == ".svg":
            text = path.read_text()
            first = re.search(r"<(?:path|rect)\b[^>]*>", text[text.index("</defs>") if "</defs>" in text else 0:])[0]
            assert re.search(r"fill(?:: |=\")(?:#ffffff|#fff|white)\b", first), f"{path.name}: {first[:200]}"
        else:
            with images.open(path) as picture:
                assert picture.convert("RGBA").getchannel("A").getextrema()[0] == 255, path.name
    assert seen > 25


def test_every_picture_is_on_a_page(root):
    used = set()
    for page in [*pages(root), *(root / "notes").glob("*.md")]:
        used |= {os.path.basename(name) for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text())}
    assert {p.name for p in (root / "docs/images").iterdir()} <= used, sorted({p.name for p in (root / "docs/images").iterdir()} - used)


def test_comments_of_headers_document_the_right_name(root):
    """The first comment belongs to the file; a section title is not the comment of the line below it."""
    headers = [*sorted((root / "libtensormass").rglob("include/**/*.h")), root / "haptic_rt/core/hrt.h"]
    assert len(headers) > 15
    for header in headers:
        text = subprocess.run(["sed", "-f", root / "tools/site/headers.sed", header], capture_output=True, text=True, check=True).stdout
        assert text.startswith("/** @file\n"), header.name
        assert not re.search(r"/\*\*<? *--", text), header.name


def dead_links(folder):
    """Returns "page: target" for each link and picture inside the folder whose file or anchor does not exist."""
    texts = {path: path.read_text() for path in folder.rglob("*.html")}
    names = {path: {html.unescape(name) for name in re.findall(r'\bid="([^"]+)"', text)} for path, text in texts.items()}
    dead = []
    for path, text in texts.items():
        for target in re.findall(r'\b(?:href|src)="([^"]+)"', text):
            target = html.unescape(target)
            if re.match(r"[a-z]+:|//", target):
                continue
            name, _, place = target.partition("#")
            file = (path.parent / urllib.parse.unquote(name.partition("?")[0])).resolve() if name else path
            if not file.exists() or place and file in names and urllib.parse.unquote(place) not in names[file]:
                dead.append(f"{path.relative_to(folder)}: {target}")
    return dead


def test_dead_link_is_detected(tmp_path):
    (tmp_path / "a.html").write_text('<h1 id="x"></h1><a href="b.html#y"></a><a href="#x"></a><img src="no.png"><a href="#z"></a>')
    (tmp_path / "b.html").write_text('<p id="y"></p><a href="a.html#y"></a>')
    assert sorted(dead_links(tmp_path)) == ["a.html: #z", "a.html: no.png", "b.html: a.html#y"]


@pytest.mark.long
def test_the_site_is_built_without_a_warning(root):
    """Builds guides, headers, Python and man pages with one search; warnings are errors. Tables scroll in their own frame."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("MAKE")}
    run = subprocess.run(["make", "--no-print-directory", "docs"], cwd=root, env=clean, capture_output=True, text=True, timeout=1800)
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr[-2000:]
    site = root / "build/site/html"
    index = (site / "searchindex.js").read_text()
    assert (site / "search.html").exists() and all(word in index for word in ("tm_mesh_create", "programs/tm-view", "python-api/tensormass", "your-own-organ", "tutorial/9-c-program"))
    assert not dead_links(site)
    for page in [*site.glob("*.html"), *(site / "tutorial").glob("*.html")]:
        text = page.read_text()
        if page.stem not in ("search", "genindex", "py-modindex"):
            assert text.count("<h1>") == 1, page.name
        assert 'href="_static/site.css' in text or 'href="../_static/site.css' in text, page.name
        assert len(re.findall(r"<table class=\"docutils", text)) == len(re.findall(r'<div class="table-wrapper[^>]*>\s*<table class="docutils', text)), page.name
