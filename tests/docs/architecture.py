"""Compares walls.md with the tree: includes, symbols, links, cycles of files, Python imports."""
import ast
import collections
import os
import pathlib
import re
import shlex
import subprocess

SOURCES = (".c", ".h", ".cpp")
EVERYWHERE = {"m", "dl", "pthread", "stdc++"}  # of the C and C++ run time


def table(page, first):
    """Returns the rows of the table whose first column is headed `first`: the texts in backticks of each column."""
    lines = page.splitlines()
    at = next(i for i, line in enumerate(lines) if re.match(rf"\| {first} \|", line))
    rows = []
    for line in lines[at + 2:]:
        if not line.startswith("|"):
            break
        rows.append([re.findall(r"`([^`]+)`", cell) for cell in line.strip("|\n").split("|")])
    return rows


class Page:
    """Returns the folders in the order of walls.md, their permitted dependencies, and the libraries they may link; the same for rooms."""
    def __init__(self, text):
        self.leans, self.links, self.gives, self.room_leans = {}, {}, {}, {}
        for folders, _, leans, links in table(text, "folder"):
            for folder in folders:
                self.leans[folder], self.links[folder] = set(leans), set(links)
        for (room,), _, gives, leans in table(text, "room"):
            self.gives[room], self.room_leans[room] = set(gives), set(leans)
        self.reach, self.room_reach = self.leans, self.room_leans

    def follow(self, found):
        """Checks includes: code that depends on a folder may use what its headers include. found: as includes() yields them."""
        shown, found = collections.defaultdict(set), list(found)
        for name, _, target in found:
            a, b = self.folder_of(name), self.folder_of(target)
            if name.endswith(".h") and a and b and a != b:
                shown[a].add(b if b in self.leans[a] or b in self.reach_of(a, shown) else target)
        self.reach = {folder: leans | self.reach_of(folder, shown) for folder, leans in self.leans.items()}
        self.room_reach = self.rooms_shown(found)
        return self

    def rooms_shown(self, found):
        """The same for rooms: users of a room may use the rooms that its public headers include, in the order of the table."""
        inside, reach = "libtensormass/src/", {}
        headers = {room: {inside + h for h in given} for room, given in self.gives.items()}
        for room, leans in self.room_leans.items():
            reach[room] = set(leans)
            for lean in leans:
                shown = {self.room_of(target) for name, _, target in found if name in headers[lean]} - {None, lean}
                reach[room] |= (shown & reach[lean]).union(*(reach[s] for s in shown & reach[lean]))
        return reach

    def reach_of(self, folder, shown):
        """Returns the folders that the headers of the folders it depends on include, transitively."""
        todo, found = [lean for lean in self.leans[folder] if lean in self.leans], set()
        while todo:
            new = shown[todo.pop()] - found
            found |= new
            todo += [n for n in new if n in self.leans]
        return found

    def beneath(self, folder):
        """Returns every folder that its rows reach."""
        found = {lean for lean in self.reach[folder] if lean in self.leans}
        return found.union(*(self.beneath(f) for f in found)) if found else found

    def folder_of(self, path):
        """Returns the folder of the table that contains a path: the longest match."""
        inside = [f for f in self.leans if path == f or path.startswith(f + "/")]
        return max(inside, key=len) if inside else None

    def room_of(self, path):
        match = re.match(r"libtensormass/src/(\w+)/", path)
        return match and match[1]

    def allows(self, a, b):
        """Returns whether a file of `a` may depend on one of `b` (paths)."""
        fa, fb = self.folder_of(a), self.folder_of(b)
        if fa != fb:
            return fb in self.reach[fa] or b in self.reach[fa]
        ra, rb = self.room_of(a), self.room_of(b)
        return ra == rb or rb in self.room_reach[ra]


def sources(root, page):
    tops = sorted({folder.split("/")[0] for folder in page.leans})
    found = [p.relative_to(root).as_posix() for top in tops for p in (root / top).rglob("*") if p.suffix in SOURCES]
    return sorted(found)


def include_paths(root):
    makefile = (root / "Makefile").read_text()
    return [p for p in re.findall(r"-I(\S+)", re.search(r"^INCLUDES := (.*)$", makefile, re.M)[1]) if "$" not in p]


def includes(root, files):
    """Yields (file, line, included file); generated messages count as files of lcm_types."""
    known, paths = set(files), include_paths(root)
    for name in files:
        for number, line in enumerate((root / name).read_text().splitlines(), 1):
            match = re.match(r'\s*#\s*include\s+"([^"]+)"', line)
            if not match:
                continue
            places = [os.path.normpath(os.path.join(p, match[1])) for p in [os.path.dirname(name), *paths]]
            target = next((p for p in places if p in known), None)
            if not target and match[1].startswith("lcm_types/tensormass"):
                target = match[1]
            yield name, number, target or match[1]


def outside_includes(root, page, files):
    """Returns sentences on includes that the page does not permit."""
    for name, number, target in includes(root, files):
        if page.folder_of(target) is None:
            yield f"{name}:{number}: \"{target}\" is in no folder of the table"
        elif not page.allows(name, target):
            yield f"{name}:{number}: {page.room_of(name) or page.folder_of(name)} includes {target}"
        elif page.room_of(target) and page.room_of(target) != page.room_of(name) and target.split("libtensormass/src/")[1] not in page.gives[page.room_of(target)]:
            yield f"{name}:{number}: {target} is its room's own; include what the room gives"


def symbols(build, files):
    """Returns {file: (defined, undefined)} symbols of the objects of these sources."""
    objects = {build / "obj" / (os.path.splitext(name)[0] + ".o"): name for name in files if not name.endswith(".h")}
    there = [o for o in objects if o.exists()]
    out = subprocess.run(["nm", "-A", "-P", *there], capture_output=True, text=True, check=True, timeout=400).stdout
    found = {objects[o]: (set(), set()) for o in there}
    for line in out.splitlines():
        place, symbol, kind = line.split()[:3]
        mine = found[objects[pathlib.Path(place.rstrip(":"))]]
        if kind == "U":
            mine[1].add(symbol)
        elif kind.isupper():
            mine[0].add(symbol)
    return found


def uses(found):
    """Returns {(file, file that defines): symbols}. A symbol that several programs define is looked up in the file's own folder."""
    definers = collections.defaultdict(list)
    for name, (defined, _) in found.items():
        for symbol in defined:
            definers[symbol].append(name)
    arrows = collections.defaultdict(set)
    for name, (_, undefined) in found.items():
        for symbol in undefined:
            near = [d for d in definers[symbol] if os.path.dirname(d) == os.path.dirname(name)]
            for definer in near or (definers[symbol] if len(definers[symbol]) == 1 else []):
                arrows[name, definer].add(symbol)
    return arrows


# Folders of a library's sources: its public headers, and the file that exports symbols.
PUBLIC = {"libtensormass/src": ("libtensormass/include", "libtensormass.so"), "libtensormass/io": ("libtensormass/io/include", "libtensormass_io.so"),
          "libtensormass/scene": ("libtensormass/scene/include", "libtensormass_scene.so")}


def outside_uses(root, build, page, arrows):
    """Returns sentences on symbols that the page does not permit. Other folders may use what a library's public header declares and the library
    exports."""
    exported, headers = set(), {}
    for include, library in PUBLIC.values():
        listed = subprocess.run(["nm", "-D", "--defined-only", build / "lib" / library], capture_output=True, text=True, check=True, timeout=300).stdout
        exported |= {line.split()[2] for line in listed.splitlines()}
        headers |= {p.relative_to(root).as_posix(): set(re.findall(r"\b\w+\b", p.read_text())) for p in (root / include).rglob("*.h")}
    for (a, b), names in sorted(arrows.items()):
        home = next((folder for folder in PUBLIC if b.startswith(folder + "/")), None)
        if home and not a.startswith(home + "/") and not page.allows(a, b):
            for name in sorted(names):
                declared = [h for h, words in headers.items() if name in words] if name in exported else []
                if not any(page.allows(a, h) for h in declared):
                    yield f"{a} uses {name} of {b}"
        elif not page.allows(a, b):
            yield f"{a} uses {', '.join(sorted(names))} of {b}"


def circles(arrows):
    """Returns groups of files that depend on each other in a cycle (Tarjan)."""
    after = collections.defaultdict(list)
    for a, b in arrows:
        if a != b:
            after[a].append(b)
    index, low, stack, found = {}, {}, [], []

    def visit(v):
        index[v] = low[v] = len(index)
        stack.append(v)
        for w in after[v]:
            if w not in index:
                visit(w)
                low[v] = min(low[v], low[w])
            elif w in stack:
                low[v] = min(low[v], index[w])
        if low[v] == index[v]:
            group = stack[stack.index(v):]
            del stack[stack.index(v):]
            if len(group) > 1:
                found.append(sorted(group))

    for v in list(after):
        if v not in index:
            visit(v)
    return sorted(found)


def python_imports(package):
    """Returns {(module, imported module of the package)}, including imports in functions and for type checkers."""
    arrows = set()
    for path in sorted(package.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.level == 1:
                names = [node.module] if node.module else [a.name for a in node.names]
                arrows |= {(path.stem, name) for name in names if (package / f"{name}.py").exists()}
    return arrows


def link_lines(root):
    """Returns {target: (folders' objects, libraries)} of everything that make links, with archives expanded."""
    run = subprocess.run(["make", "-Bn", "programs"], cwd=root, capture_output=True, text=True, timeout=400)
    assert run.returncode == 0, run.stderr
    parts, libraries = {}, {}
    for line in run.stdout.splitlines():
        for command in line.split("&&"):
            words = shlex.split(command, comments=True) if command.count("'") % 2 == 0 and command.count('"') % 2 == 0 else []
            if "rcs" in words and words[0] == "ar":
                target, rest = words[2], words[3:]
            elif "-o" in words and "-c" not in words and words[0] in ("gcc", "g++", "clang", "clang++"):
                target, rest = words[words.index("-o") + 1], words
            else:
                continue
            parts[target] = [w for w in rest if w.endswith((".o", ".a")) and w != target]
            libraries[target] = {w[2:] for w in rest if w.startswith("-l")}

    def opened(target):
        for part in parts.get(target, []):
            if part.endswith(".o"):
                yield re.sub(r"^.*?/obj/", "", part)
            else:
                yield from opened(part)

    return {target: (list(opened(target)), [p for p in parts[target] if p.endswith(".o")], libraries[target]) for target in parts}


def outside_links(page, links):
    """A linked target belongs to the folder of its first own object."""
    for target, (objects, own, libraries) in sorted(links.items()):
        own_path = re.sub(r"^.*?/obj/", "", own[0])
        home = page.folder_of(own_path)
        if home is None:
            yield f"{target}: {own_path} is in no folder of the table"
            continue
        leans = page.reach[home] | page.beneath(home)
        for sources, (include, _) in PUBLIC.items():
            if any(folder.startswith(include) for folder in leans):
                leans.add(sources)  # the library of those headers
        for folder in sorted({page.folder_of(p) for p in objects} - leans - {home, None}):
            yield f"{target} of {home} links {folder}"
        for library in sorted(libraries - EVERYWHERE - page.links[home]):
            yield f"{target} of {home} links -l{library}"
