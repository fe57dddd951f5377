"""Words: no replaced private word returns, and no word is misspelt (docs/style.md)."""
import re
import subprocess
import sys

import pytest

from renamed import IDENTIFIERS, PARTS, PUBLIC, WORDS, rows, sources

HERE = ("tests/docs/test_words.py", "tests/docs/renamed.py", "tests/docs/renamed.txt", "docs/style.md", "CHANGELOG.md", "libtensormass/scene/scene_renamed.c",
        "tests/sim/test_renamed.py")


def tracked(root):
    for name in subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True, check=True).stdout.splitlines():
        path = root / name
        if name not in HERE and not name.startswith(("notes/", "meshes/", "tests/fuzz/corpus/")) and sources(name) and path.is_file():
            yield name, path.read_text(encoding="utf-8", errors="replace")


def found(text, pattern):
    return [(text.count("\n", 0, m.start()) + 1, m[0]) for m in pattern.finditer(text)]


def left_of(root, names, ending="", boundary=r"(?<![A-Za-z0-9_])(?:%s)(?![A-Za-z0-9_])", fold=lambda text: text):
    """Returns "file:line: write NEW instead of OLD" for each name; searches a text line by line only if it contains one."""
    left = []
    for name, text in tracked(root):
        if name.endswith(ending):
            text = fold(text)
            tokens = set(re.findall(r"[A-Za-z_]\w*", text))
            for old in (w for w in names if w.split()[0] in tokens):
                left += [f"{name}:{line}: write '{names[old]}' instead of '{old}'" for line, _ in found(text, re.compile(boundary % re.escape(old)))]
    return left


def test_no_old_public_name_is_left(root):
    left = left_of(root, PUBLIC)
    assert not left, "\n".join(left)


def test_no_replaced_identifier_comes_back(root):
    left = left_of(root, IDENTIFIERS, (".c", ".h", ".cpp", ".hpp"))
    assert not left, "\n".join(left)


def test_no_private_word_comes_back(root):
    left = left_of(root, WORDS, boundary=r"(?<![-\w])%s\b", fold=str.lower)
    assert not left, "\n".join(left)


CODE = re.compile(r'"""(?s:.*?)"""|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|/\*(?s:.*?)\*/')


def names_with_a_private_part(text):
    """Returns (name, part) of each name in the code with a private word between its underscores or capitals; strings and comments are left out."""
    code = re.sub(r"(?://|#(?! *define)).*", "", CODE.sub(" ", text))
    found = {name: PARTS.keys() & {part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)} for name in set(re.findall(r"[A-Za-z_]\w*", code))}
    return sorted((name, part) for name, parts in found.items() for part in parts)


def test_no_private_word_is_part_of_a_name(root):
    left = [f"{path}: '{name}': write '{PARTS[part]}' instead of '{part}'" for path, text in tracked(root)
            if path.endswith((".c", ".h", ".cpp", ".hpp", ".py", ".js", ".mjs")) for name, part in names_with_a_private_part(text)]
    assert not left, "\n".join(left)


def test_private_part_of_a_name_is_detected():
    assert names_with_a_private_part("/* dear */ int tm_swollen_of, dearTo; f(\"mend\"); // rubs\n") == [("dearTo", "dear"), ("tm_swollen_of", "swollen")]
    assert not names_with_a_private_part("int amends, tm_seated;\n")


NOTE = "notes/2026-11-24-words.md"


def test_names_of_the_note_on_words_exist(root):
    """Each row of the first list of private words is answered; a name that an answer gives is in the sources."""
    rows = [line.split("|")[1:-1] for line in (root / NOTE).read_text().splitlines() if line.startswith("| ")][2:]
    names = set(re.findall(r"[A-Za-z_]\w*", "\n".join(text for path, text in tracked(root) if not path.endswith(".md"))))
    assert len(rows) > 140 and all(len(r) == 4 and r[3].strip().startswith(("done", "kept", "answered")) for r in rows)
    missing = [name for r in rows for name in re.findall(r"`(\w+)`", r[2]) if name not in names]
    assert not missing, missing


def test_lists_of_renamed_words_are_complete():
    assert len(PUBLIC) > 60 and len(IDENTIFIERS) > 200 and len(WORDS) > 10
    assert not set(PUBLIC) & set(PUBLIC.values()) and len(rows()) == len({(kind == "part", old) for kind, old, _ in rows()}), "a name stands on both sides, or twice"


def test_planted_old_name_is_detected(tmp_path):
    assert found("a tm_patch_maker *m;\n", re.compile(r"(?<![A-Za-z0-9_])tm_patch_maker(?![A-Za-z0-9_])")) == [(1, "tm_patch_maker")]
    assert not found("tm_patch_makers", re.compile(r"(?<![A-Za-z0-9_])tm_patch_maker(?![A-Za-z0-9_])"))


def test_spelling(root):
    """codespell with its own dictionary and the project's list of correct words that it does not know."""
    pytest.importorskip("codespell_lib", reason="the Python environment is older than tools/requirements.txt: make venv")
    names = [name for name, _ in tracked(root) if name.endswith((".c", ".h", ".cpp", ".hpp", ".py", ".md", ".sh", ".mk", ".lcm", ".yaml", "Makefile"))]
    run = subprocess.run([sys.executable, "-m", "codespell_lib", "--ignore-words", root / "tests/docs/spelling.txt", *names], cwd=root, capture_output=True,
                         text=True, timeout=300)
    assert len(names) > 800 and run.returncode == 0, run.stdout


def test_misspelling_is_detected(root, tmp_path):
    pytest.importorskip("codespell_lib")
    wrong = "rec" + "ieve"
    (tmp_path / "a.c").write_text(f"/* {wrong} */\n")
    run = subprocess.run([sys.executable, "-m", "codespell_lib", "--ignore-words", root / "tests/docs/spelling.txt", tmp_path / "a.c"], capture_output=True, text=True)
    assert run.returncode != 0 and wrong in run.stdout
