"""Man pages and completion from the programs' help; in the long form the complete reference as HTML (`make docs`, warnings are errors)."""
import os
import re
import subprocess
import sys

import pytest

NAMES = ["tm-sim", "tm-mesh", "tm-scene", "tm-view", "tm-play", "tm-precompute", "tm-session", "tm-organ", "tm-study", "tm-fit", "tm-evaluate", "tm-accuracy", "tm-stability", "haptic-rt", "tm-device"]


@pytest.fixture(scope="module")
def reference(root, bin, tmp_path_factory):
    out = tmp_path_factory.mktemp("reference")
    subprocess.run([sys.executable, root / "tools/reference/make_reference.py", bin, out, "0.2.0", *NAMES], check=True, timeout=400)
    return out


def completions(reference, bin, *words):
    """Returns bash's completions after these words."""
    script = f"""source {reference}/completions/{words[0]}; compopt() {{ :; }}; COMP_WORDS=({bin}/{' '.join(words[:-1])} '{words[-1]}'); COMP_CWORD={len(words) - 1}
        _{words[0].replace('-', '_')}; printf '%s\\n' "${{COMPREPLY[@]}}" """
    return set(subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True, timeout=120).stdout.split())


@pytest.mark.parametrize("name", NAMES)
def test_man_pages_list_every_option(reference, bin, name):
    page = reference / "man1" / f"{name}.1"
    shown = subprocess.run(["groff", "-ww", "-man", "-Tutf8", "-P-c", page], capture_output=True, text=True, check=True, env=dict(os.environ, LC_ALL="C.UTF-8"))
    assert shown.stderr == ""
    told = subprocess.run([bin / name, "--help"], capture_output=True, text=True, check=True).stdout
    text = page.read_text().replace("\\-", "-")
    options = set(re.findall(r"(?<![\w-])--[a-z][\w-]*", told))
    assert "--help" in options and [o for o in options if o not in text] == []
    assert text.index(".SH NAME") < text.index(".SH SYNOPSIS") < text.index(".SH DESCRIPTION")


@pytest.mark.parametrize("name", NAMES)
def test_every_option_is_completed(reference, bin, name):
    told = subprocess.run([bin / name, "--help"], capture_output=True, text=True, check=True).stdout
    own = re.sub(r"(?:tm-[a-z]+|haptic-rt) --[a-z-]+", "", told)
    assert completions(reference, bin, name, "--") >= set(re.findall(r"(?<![\w-])--[a-z][\w-]*", own)) >= {"--help"}


def test_words_that_follow_an_option_are_completed(reference, bin):
    assert completions(reference, bin, "haptic-rt", "--mode", "") == {"probe", "grasper", "cautery"}
    assert completions(reference, bin, "haptic-rt", "--extrapolator", "p") == {"position", "paper_position"}
    assert "poisson-0.49" in completions(reference, bin, "tm-stability", "--case", "poisson")
    assert completions(reference, bin, "tm-mesh", "re") == {"refine", "repair"}


@pytest.mark.long
def test_the_reference_is_built_without_a_warning(root):
    run = subprocess.run(["make", "--no-print-directory", "docs"], cwd=root, capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stdout[-3000:] + run.stderr[-3000:]
    html = root / run.stdout.split()[-1]
    assert "tm_world_step" in (html.parent / "c/world.html").read_text() and (html.parent / "search.html").exists()
