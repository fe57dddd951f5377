"""The type `Law` of web/npm/index.d.ts, which is written by hand, has the names of TM_NONLINEAR_LAWS."""
import re

from paths import ROOT


def names_of_the_library():
    """Returns "linear" and the name of each row, in the order of the table."""
    header = (ROOT / "libtensormass/include/tensormass/material.h").read_text()
    table = re.search(r"#define TM_NONLINEAR_LAWS\(ROW\)((?:.*\\\n)+.*)", header)[1]
    files = [ROOT / f"libtensormass/src/material/{stem}_law.h" for stem in re.findall(r"ROW\(\w+, (\w+)\)", table)]
    return ["linear", *(re.search(r'\.name = "([^"]+)"', file.read_text())[1] for file in files)]


def test_the_declared_laws_are_those_of_the_library():
    declared = re.search(r"export type Law = ([^;]+);", (ROOT / "web/npm/index.d.ts").read_text())[1]
    assert [word.strip(" '") for word in declared.split("|")] == names_of_the_library()
