"""Commands and links of the pages: every link is valid; every command line of README and docs/ names existing programs, options and targets, and
scenes that load."""
import os
import re
import shlex
import subprocess
import sys

import pytest

sys.path.insert(0, "tools/reference")
import help_text  # noqa: E402

PROGRAMS = r"(?:build/bin/|\./)?(tm-[a-z]+|haptic-rt)"
# Options of make itself, and of third-party programs.
LEADING = re.compile(r"^(?:\$ |sudo |time |[A-Z_]+=\S+ |nice (?:-n ?\d+ )?|taskset \S+ (?:\S+ )?|chrt \S+ \d+ )+")


def pages(root):
    return [root / "README.md", root / "CONTRIBUTING.md", *sorted((root / "docs").rglob("*.md")), *sorted((root / "examples").rglob("README.md"))]


def anchors(text):
    """Returns a heading's anchor as GitHub forms it."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    heads = re.findall(r"^#+ (.*)", text, re.M)
    return {re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", h).lower()).replace(" ", "-") for h in heads}


def test_every_link_leads_somewhere(root):
    bad = []
    for page in [*pages(root), *sorted((root / "notes").glob("*.md"))]:
        text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
        for target in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"`[^`]*`", "", text)):
            if re.match(r"[a-z]+:", target):
                continue
            name, _, anchor = target.partition("#")
            path = (page.parent / name).resolve() if name else page
            if not path.exists():
                bad.append(f"{page.name}: {target}: no such file")
            elif anchor and anchor not in anchors(path.read_text()):
                bad.append(f"{page.name}: {target}: no such heading")
    assert not bad, "\n".join(bad)


def commands(page):
    """Returns the command lines of a page: of its code blocks, and inline ones."""
    text = page.read_text()
    for block in re.findall(r"^```(?:sh|bash|console|)\n(.*?)^```|((?:^    \S.*\n)+)", text, re.M | re.S):
        for line in re.sub(r"\\\n\s*", " ", "".join(block)).split("\n"):
            yield line.strip()
    for word in re.findall(r"`([^`\n]+)`", text):
        yield word


def parts_of(line):
    """Returns the commands of a line as word lists, without comments, redirections and shell syntax."""
    line = LEADING.sub("", line.split("  #")[0].split(" # ")[0])
    for part in re.split(r" *(?:&&|\|\||;|(?<!\|)\|(?!\|)|(?<!\d)&) *", line):
        part = LEADING.sub("", part.strip())
        try:
            yield shlex.split(part)
        except ValueError:
            yield part.split()


@pytest.fixture(scope="module")
def options(bin):
    """Returns the long and short options in each program's help, including its commands'."""
    known = {}

    def of(name):
        if name not in known:
            told = help_text.read(subprocess.run([bin / name, "--help"], capture_output=True, text=True, check=True, timeout=120).stdout)
            helps = [told.text] + [subprocess.run([bin / name, c, "--help"], capture_output=True, text=True, check=True, timeout=120).stdout for c in told.commands]
            known[name] = set(re.findall(r"(?<![\w-])--?[A-Za-z][\w-]*", "\n".join(helps)))
        return known[name]
    return of


def test_every_option_of_a_command_line_exists(root, bin, options):
    bad, seen = [], 0
    for page in pages(root):
        for line in commands(page):
            for words in parts_of(line):
                program = re.fullmatch(PROGRAMS, words[0]) if words else None
                if not program or len(words) < 2:
                    continue
                if not (bin / program[1]).exists():
                    bad.append(f"{page.name}: {line}: no program {program[1]}")
                    continue
                for word in words[1:]:
                    option = re.match(r"--?[A-Za-z][\w-]*", word)
                    if option:
                        seen += 1
                        if option[0] not in options(program[1]):
                            bad.append(f"{page.name}: {line}: {program[1]} has no {option[0]}")
    assert seen > 50, "the pages show commands"
    assert not bad, "\n".join(dict.fromkeys(bad))


def test_every_target_exists(root):
    makefiles = "\n".join(p.read_text() for p in [root / "Makefile", *root.rglob("*.mk")] if "build" not in p.parts)
    targets = {t for line in re.findall(r"^([\w %./-]+):(?!=)", makefiles, re.M) for t in line.split()} | {t for line in re.findall(r"^\.PHONY: (.*)", makefiles, re.M) for t in line.split()}
    bad, seen = [], 0
    for page in pages(root):
        for line in commands(page):
            for words in parts_of(line):
                if words[:1] != ["make"]:
                    continue
                for word in words[1:]:
                    if re.fullmatch(r"[a-z][a-z-]*", word):
                        seen += 1
                        if word not in targets:
                            bad.append(f"{page.name}: {line}: no target {word}")
    assert seen > 20, "the pages name targets"
    assert not bad, "\n".join(bad)


def test_make_demo_opens_with_what_it_will_do(root, build, tmp_path):
    """`make demo` prints before the first compiler line: what runs, how long, where results are, and what is built first."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("MAKE")}
    first = subprocess.run(["make", "-n", "--no-print-directory", "demo", f"BUILD={tmp_path}"], cwd=root, env=clean, capture_output=True, text=True, timeout=300).stdout.splitlines()[0]
    assert first.startswith("apps/demo/opening.sh")
    for out, of_the_build in ((tmp_path, "builds everything first"), (build, "builds first what has changed")):
        said = subprocess.run([root / "apps/demo/opening.sh", out, "a.yaml"], capture_output=True, text=True, check=True, timeout=60).stdout
        assert all(words in said for words in ("demo: runs a.yaml", "minute", f"results in {out}/demo", of_the_build)), said


def test_scenes_of_command_lines_load(root, bin):
    """Command lines of tm-sim with a scene of the tree: --set and --unset name keys of the scene. --check builds it and runs nothing."""
    tried = set()
    for page in pages(root):
        for line in commands(page):
            for words in parts_of(line):
                scene = next((w for w in words[1:] if w.startswith("apps/scenes/") and (root / w).is_file()), None)
                if not scene or not words[0].endswith("tm-sim"):
                    continue
                # WORDS in capitals stand for the reader's own files
                pairs = [(w, words[i + 1]) for i, w in enumerate(words[:-1]) if w in ("--set", "--unset")]
                sets = [w for pair in pairs if not re.search(r"=[A-Z]+$", pair[1]) for w in pair]
                tried.add((scene, *sets))
    assert len(tried) >= 2, "the pages show scenes"
    for scene, *sets in sorted(tried):
        run = subprocess.run([bin / "tm-sim", scene, "--check", "--quiet", *sets], cwd=root, capture_output=True, text=True, timeout=400)
        assert run.returncode == 0, f"{scene} {sets}: {run.stderr}"


def test_every_guide_is_in_the_site(root):
    """Checks the one list of pages that is written by hand before `make docs` would: four kinds of pages, each page once."""
    index = (root / "tools/site/index.md").read_text()
    assert re.findall(r"^:caption: (.*)$", index, re.M) == ["Tutorial", "How-to", "Reference", "Explanation"]
    names = re.findall(r"^((?:tutorial/\d-)?[a-z][a-z-]*)$", index, re.M)
    listed = set(names)
    guides = {str(page.relative_to(root / "docs").with_suffix("")) for page in (root / "docs").rglob("*.md")}
    assert guides <= listed, sorted(guides - listed)
    assert listed - guides == {"c-api", "programs"} and len(names) == len(listed), sorted(listed - guides)


def test_headings_of_a_page_are_unique(root):
    """Headings of a page are unique: a section that a merge duplicated becomes outdated in one of its places."""
    for page in pages(root):
        headings = re.findall(r"^##+ .*$", page.read_text(), re.M)
        twice = {h for h in headings if headings.count(h) > 1}
        assert not twice or page.name == "scene-reference.md", f"{page.name}: {twice}"
