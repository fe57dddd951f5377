"""Reads the list of replaced names and words (renamed.txt): kind, old, new, one row each."""
import pathlib
import re

LIST = pathlib.Path(__file__).resolve().parent / "renamed.txt"


def rows():
    return [tuple(line.split("\t")) for line in LIST.read_text().splitlines() if line and not line.startswith("#")]


def of(kind):
    return {old: new for k, old, new in rows() if k == kind}


def sources(name):
    return re.search(r"(\.(c|h|cpp|hpp|py|md|mk|sh|lcm|yaml|in|html|js|css)|Makefile|\.ci/run)$", name) is not None


PUBLIC = of("public")
IDENTIFIERS = of("internal")
PARTS = of("part")
WORDS = of("word")
