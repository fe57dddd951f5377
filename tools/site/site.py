"""site.py OUT MAN [PAGE]: collects the pages' sources in OUT: docs/ with its tutorial, one page for each public header, one for each program's man page.
PAGE: the page that `make web` built; the first screen then leads to it."""
import pathlib
import re
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
TREE = re.compile(r"(?<!!)\[([^\]]*)\]\((\.\./[^)]*)\)")  # links out of docs/ into the tree: replaced by their text


def headers():
    """Returns the public headers by component."""
    return {"The library": sorted((ROOT / "libtensormass/include/tensormass").glob("*.h")),
            "Solvers, files": sorted(p for p in (ROOT / "libtensormass").rglob("include/*.h") if p.name != "tensormass.h"),
            "The controller": [ROOT / "haptic_rt/core/hrt.h"]}


def guides(out):
    (out / "tutorial").mkdir()
    for page in (ROOT / "docs").rglob("*.md"):
        place = page.relative_to(ROOT / "docs")
        text = page.read_text()
        (out / place).write_text(TREE.sub(r"\1", text) if place.parent == pathlib.Path(".") else text)
    shutil.copytree(ROOT / "docs/images", out / "images")


def c_pages(out):
    lines = ["# C interface", "", "Every public header, from its own comments; [a guide](library-guide.md) with examples goes before.", ""]
    (out / "c").mkdir()
    for title, files in headers().items():
        lines += [f"```{{toctree}}", f":caption: {title}", ":maxdepth: 1", *[f"c/{f.stem}" for f in files], "```", ""]
        for file in files:
            (out / "c" / f"{file.stem}.md").write_text(f"# {file.name}\n\n```{{doxygenfile}} {file.name}\n:project: tensormass\n```\n")
    (out / "c-api.md").write_text("\n".join(lines))


def programs(out, man):
    (out / "programs").mkdir()
    names = sorted(p.stem for p in man.glob("*.1"))
    for name in names:
        text = subprocess.run(["man", "-l", "--encoding=UTF-8", man / f"{name}.1"], env={"MANWIDTH": "110", "PATH": "/usr/bin:/bin"}, capture_output=True, text=True, check=True).stdout
        (out / "programs" / f"{name}.md").write_text(f"# {name}\n\n```text\n{text.rstrip()}\n```\n")
    (out / "programs.md").write_text("# Programs\n\nTheir man pages.\n\n```{toctree}\n:maxdepth: 1\n" + "\n".join(f"programs/{n}" for n in names) + "\n```\n")


TRY = """```{raw} html
<p><a class="try" href="try/index.html">Press, grasp and cut it here, in your browser</a></p>
<iframe class="try" src="try/index.html?mesh=1,180 tetrahedra" title="A liver in your browser" loading="lazy"></iframe>
```
"""


def main():
    out, man = map(pathlib.Path, sys.argv[1:3])
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    guides(out)
    c_pages(out)
    programs(out, man)
    (out / "static").mkdir()
    for name, place in (("conf.py", out), ("index.md", out), ("site.css", out / "static")):
        shutil.copy(pathlib.Path(__file__).with_name(name), place)
    index, picture = out / "index.md", "![A liver grasped, pulled and cut](images/demo.png)\n"
    if len(sys.argv) > 3:
        index.write_text(index.read_text().replace(picture, TRY))


if __name__ == "__main__":
    main()
