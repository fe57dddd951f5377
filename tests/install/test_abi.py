"""Compares the C interface with a committed list: existing symbols stay, and structs keep their sizes."""
import pathlib
import platform
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import abi  # noqa: E402

LIST = pathlib.Path(__file__).resolve().parent / "abi.txt"
HOW = "If it is meant: when something went or changed its size, raise the number that breaks the interface (VERSION in the Makefile; CONTRIBUTING.md), unless " \
      "that number was never released; then write the list anew: build/venv/bin/python tests/install/abi.py > tests/install/abi.txt"


@pytest.mark.skipif(platform.machine() not in ("x86_64", "aarch64"), reason="the list is of machines with 64 bits")
def test_interface_is_the_committed_one(build):
    listed, now = LIST.read_text().splitlines(), abi.interface(build)
    gone, new = sorted(set(listed) - set(now)), sorted(set(now) - set(listed))
    assert not gone and not new, f"gone: {gone}; new: {new}. {HOW}"


def test_definition_structs_carry_their_size(root):
    """Every struct with a cookie has its size as the next member, and every _default function sets both."""
    headers = "\n".join(h.read_text() for h in (root / "libtensormass/include").rglob("*.h"))
    assert headers.count("uint32_t cookie") == headers.count("uint32_t cookie, size;") > 10
    sources = "\n".join(s.read_text() for folder in ("src", "solve") for s in (root / "libtensormass" / folder).rglob("*.c"))
    assert sources.count(".cookie = TM") == sources.count(".size = sizeof(tm_") - sources.count("tm_stage),") - sources.count("tm_model_kind),")
