"""tutorial.py [CHAPTER ...]: follows docs/tutorial as a reader does, and keeps each chapter's picture as docs/images/tutorial-N.png.

tests/docs/test_tutorial.py follows the same chapters by the functions here. Run it after a chapter or a picture's look changed:
build/venv/bin/python tools/pictures/tutorial.py"""
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
USED = ("meshes", "apps", "libtensormass", "tests", "docs")  # folders of the source tree that a chapter reads
NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?"


def chapters():
    return sorted((ROOT / "docs/tutorial").glob("[1-9]-*.md"))


def steps(page):
    """Returns the reader's steps in order: ("file", (name, text)), ("type", commands), ("see", lines)."""
    for name, kind, text in re.findall(r"(?:Save as `(tutorial/[^`]+)`:\n\n)?^```(\w+)\n(.*?)^```", page.read_text(), re.M | re.S):
        if name:
            yield "file", (name, text)
        elif kind == "sh":
            yield "type", text
        elif kind == "text":
            yield "see", text.strip().split("\n")


def prepare(folder, build, page):
    """Makes a folder like the source tree, with the files of the previous chapters."""
    (folder / "tutorial").mkdir(parents=True)
    for name in USED:
        (folder / name).symlink_to(ROOT / name)
    (folder / "build").symlink_to(build)
    for before in chapters():
        if before.name < page.name:
            for kind, what in steps(before):
                if kind == "file":
                    (folder / what[0]).write_text(what[1])


def shows(expected, line, tolerance=0.02):
    """Returns whether a line matches the expected one: "…" matches anything, at the end also nothing, numbers agree within the tolerance."""
    pattern = ""
    for part in re.split(rf"(…|{NUMBER}|\s+)", expected.strip()):
        pattern += ".*?" if part == "…" else f"({NUMBER})" if re.fullmatch(NUMBER, part) else r"\s+" if part.isspace() else re.escape(part)
    found = re.fullmatch(pattern, line.strip()) or re.fullmatch(pattern, line.strip() + " ")
    numbers = [float(n) for n in re.findall(NUMBER, expected)]
    return bool(found) and all(abs(float(g) - n) <= tolerance * abs(n) for g, n in zip(found.groups(), numbers))


def follow(page, folder, build):
    """Writes, types and compares everything in a chapter; returns the expected lines that did not appear."""
    prepare(folder, build, page)
    said, missing = "", []
    for kind, what in steps(page):
        if kind == "file":
            (folder / what[0]).write_text(what[1])
        elif kind == "type" and not what.startswith("make "):
            run = subprocess.run(["bash", "-ec", what], cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300)
            said = run.stdout
            if run.returncode:
                return [f"{what}: exit {run.returncode}: {said}"]
        elif kind == "see":
            lines = said.split("\n")
            for expected in what:
                at = next((i for i, line in enumerate(lines) if shows(expected, line)), None)
                if at is None:
                    missing.append(f"{page.name}: not seen: {expected}\nbut:\n{said}")
                else:
                    lines = lines[at + 1:]
    return missing


def picture(page):
    """Returns the file that a chapter's commands draw, and its place on the page. (None, None): the page shows a picture drawn elsewhere."""
    shown = re.search(r"!\[[^]]*\]\(\.\./images/(tutorial-\d\.png)\)", page.read_text())
    drawn = re.findall(r"tutorial/\w+\.png", page.read_text())
    return (drawn[-1], shown[1]) if shown and drawn else (None, None)


def keep(source, target):
    """Saves a picture at the width at which pages show it."""
    from PIL import Image
    drawn = Image.open(source).convert("RGB")
    drawn.resize((720, 720 * drawn.height // drawn.width), Image.Resampling.LANCZOS).save(target, optimize=True)


def main():
    for page in chapters():
        drawn, shown = picture(page)
        if not drawn or (sys.argv[1:] and page.name[0] not in sys.argv[1:]):
            continue
        with tempfile.TemporaryDirectory() as folder:
            missing = follow(page, pathlib.Path(folder) / "tree", ROOT / "build")
            if missing:
                sys.exit("\n".join(missing))
            keep(pathlib.Path(folder) / "tree" / drawn, ROOT / "docs/images" / shown)
        print(f"{page.name}: docs/images/{shown}")


if __name__ == "__main__":
    main()
