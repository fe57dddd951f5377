"""The short form of `make stability`: every hard case has its expected verdict."""
import json
import subprocess
import sys

import pytest


@pytest.fixture(scope="module")
def page(bin, root, long_run, once):
    def make(out):
        quick = [] if long_run else ["--quick"]
        run = subprocess.run([bin / "tm-stability", *quick, "--json", out / "verdicts.json"], cwd=root, capture_output=True, text=True, timeout=3000)
        assert run.returncode in (0, 1), run.stderr
        subprocess.run([sys.executable, root / "apps/studies/stability/page.py", out / "verdicts.json", "-o", out], check=True, timeout=900)

    out = once("stability", make)
    return out, json.loads((out / "stability.json").read_text())


def cases(root):
    """Names from the tables: each case is a test of its own, and a new row needs no change here."""
    import re
    rows = []
    for source in sorted((root / "apps/studies/stability").glob("cases_*.c")):
        rows += re.findall(r"^    \{[A-Z]+, \"([\w.-]+)\"", source.read_text(), re.M)
    return rows


def pytest_generate_tests(metafunc):
    from paths import ROOT
    if "case" in metafunc.fixturenames:
        metafunc.parametrize("case", cases(ROOT))


def test_hard_case_has_its_verdict(page, case):
    own = [c for c in page[1]["cases"] if c["name"] == case]
    assert len(own) == 1, f"{case} did not run"
    assert own[0]["good"], own[0]["text"]
    assert own[0]["verdict"] != "refused" or ";" in own[0]["text"], f"the message does not say what to do: {own[0]['text']}"


def test_page_names_every_case(page, root):
    html = (page[0] / "index.html").read_text()
    for case in cases(root):
        assert f"tm-stability --case {case}" in html


def test_the_documentation_counts_them(root):
    assert f"`make stability` runs {len(cases(root))} hard cases" in (root / "docs/stability.md").read_text()


def test_unknown_case_is_refused(bin):
    run = subprocess.run([bin / "tm-stability", "--case", "nonsense"], capture_output=True, text=True)
    assert run.returncode == 2 and "--list lists them" in run.stderr
