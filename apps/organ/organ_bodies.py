"""Makes bodies of an organ's regions: a mesh for each, and the scene that names them."""
import re


def names_of(figures, refusal):
    """Returns the names of the regions, or raises refusal(message) where they make no bodies."""
    names = [r["name"] for r in figures["regions"]]
    if len(names) < 2:
        raise refusal("--bodies needs two regions; this has one, %s" % "".join(names))
    odd = [n for n in names if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", n) or n == "self"]
    if odd:
        raise refusal("--bodies: the region %r is no name for a body; use letters, digits and _ (--label N=NAME)" % odd[0])
    return names


def write_bodies(path, names):
    """Changes tm-scene's scene of one mesh into a scene of bodies that touch each other."""
    text = path.read_text()
    mesh = re.search(r'^  mesh: "[^"]*"(.*)\n', text, re.M)
    text = text.replace(mesh[0], "")
    for name in names:
        text = re.sub(r'^    "%s": ' % re.escape(name), '    "%s.%s": ' % (name, name), text, flags=re.M)
        text = re.sub(r'\bgroup: "(%s_[^"]*)"' % re.escape(name), r'group: "%s.\1"' % name, text)
    bodies = "".join(f'  {name}: {{mesh: "{name}.msh"}}\n' for name in names)
    head = f"# One body a label ({', '.join(names)}):{mesh[1].replace(' #', '')}. Regions and groups are called BODY.NAME (docs/bodies.md).\nbodies:\n{bodies}"
    tie = "ties: {between: [{from: %s, to: %s, within: 10 mm, spacing: 6 mm, stiffness: 60 N/m, break: 1 N}]}" % (names[1], names[0])
    touch = f"touch: # bodies keep apart. Uncomment to tie them to each other, as peritoneum does:\n# {tie}\n"
    text = re.sub(r"^#   touch: .*\n", "", text, flags=re.M)  # of the list of what may be added
    path.write_text(text.replace("\ntissue:\n", f"\n{head}tissue:\n", 1).replace("\ncontact: #", f"\n{touch}contact: #", 1))


def split(call, path, figures, names):
    """Writes NAME.msh beside organ.msh for each body. Returns how many vertices bodies share; then nothing is left."""
    vertices = 0
    for name in names:
        said, _ = call("tm-mesh", "convert", "--region", name, path("organ.msh"), "-o", path(name + ".msh"))
        vertices += int(re.search(r"(\d+) vertices", said)[1])
    if vertices > figures["vertices"]:
        for name in names:
            path(name + ".msh").unlink()
    return vertices - figures["vertices"]


def shared_refusal(shared, kind):
    """Returns the message about bodies that hold each other."""
    remedy = {"image": "raise --budget if the gap is narrower than a tetrahedron, leave background between them, also between voxels that meet at an edge or a corner,"}
    return "--bodies: regions share %d vertices, and so hold each other; %s or leave --bodies out" % (shared, remedy.get(kind, "separate them in the mesh"))
