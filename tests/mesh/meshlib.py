"""Writes small meshes in every format without the library, so that its reader is tested against the formats and not against its own writer."""
import itertools
import struct
import subprocess


class Mesh:
    def __init__(self, points, tets, surface=()):
        self.points = [list(p) for p in points]
        self.tets = [list(t) for t in tets]  # indices from 0
        self.region = [1] * len(tets)        # physical tag
        self.names = {}                      # (dimension, tag) -> name
        self.surface = list(surface)         # (triangle, physical tag)
        self.lines, self.dots = [], []       # ((a, b), tag), (a, tag)
        self.vertex_tag = list(range(1, len(self.points) + 1))
        self.tet_tag = None                  # default: after the other elements


def block(n=2, size=0.1):
    """Makes n x n x n cubes of six tetrahedra each."""
    def at(i, j, k):
        return (k * (n + 1) + j) * (n + 1) + i
    points = [(size * i / n, size * j / n, size * k / n)
              for k in range(n + 1) for j in range(n + 1) for i in range(n + 1)]
    tets = []
    for i, j, k in itertools.product(range(n), repeat=3):
        for order, sign in (((0, 1, 2), 1), ((0, 2, 1), -1), ((1, 0, 2), -1), ((1, 2, 0), 1), ((2, 0, 1), 1), ((2, 1, 0), -1)):
            c = [i, j, k]
            t = [at(*c)]
            for axis in order:
                c[axis] += 1
                t.append(at(*c))
            if sign < 0:
                t[2], t[3] = t[3], t[2]
            tets.append(t)
    return Mesh(points, tets)


def elements(m):
    """Returns (tag, type, physical, [vertex tags]) of every element."""
    out = []
    for a, g in m.dots:
        out.append((15, g, [a]))
    for e, g in m.lines:
        out.append((1, g, list(e)))
    for f, g in m.surface:
        out.append((2, g, list(f)))
    numbered = [(i + 1, ty, g, [m.vertex_tag[v] for v in vs]) for i, (ty, g, vs) in enumerate(out)]
    first = len(out) + 1
    for i, t in enumerate(m.tets):
        tag = m.tet_tag[i] if m.tet_tag else first + i
        numbered.append((tag, 4, m.region[i], [m.vertex_tag[v] for v in t]))
    return numbered


def names_text(m):
    if not m.names:
        return ""
    return "$PhysicalNames\n%d\n%s$EndPhysicalNames\n" % (
        len(m.names), "".join('%d %d "%s"\n' % (d, t, n) for (d, t), n in sorted(m.names.items())))


def msh2(m):
    s = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n" + names_text(m) + "$Nodes\n%d\n" % len(m.points)
    for tag, p in zip(m.vertex_tag, m.points):
        s += "%d %r %r %r\n" % (tag, *p) if not isinstance(p[0], str) else "%d %s %s %s\n" % (tag, *p)
    e = elements(m)
    s += "$EndNodes\n$Elements\n%d\n" % len(e)
    for tag, ty, g, vs in e:
        s += "%d %d 2 %d %d %s\n" % (tag, ty, g, g, " ".join(map(str, vs)))
    return s + "$EndElements\n"


def msh2_binary(m):
    e = elements(m)
    b = b"$MeshFormat\n2.2 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n" + names_text(m).encode()
    b += b"$Nodes\n%d\n" % len(m.points)
    for tag, p in zip(m.vertex_tag, m.points):
        b += struct.pack("<i3d", tag, *p)
    b += b"\n$EndNodes\n$Elements\n%d\n" % len(e)
    for tag, ty, g, vs in e:
        b += struct.pack("<3i", ty, 1, 2) + struct.pack("<%di" % (3 + len(vs)), tag, g, g, *vs)
    return b + b"\n$EndElements\n"


def blocks4(m):
    """Writes entities of 4.1: one for each (dimension, physical), holding its elements; all vertices in the last."""
    dim = {15: 0, 1: 1, 2: 2, 4: 3}
    groups = {}
    for tag, ty, g, vs in elements(m):
        groups.setdefault((dim[ty], g, ty), []).append((tag, vs))
    return sorted(groups.items())


def msh4(m):
    groups = blocks4(m)
    per = [[g for (d, g, _), _ in groups if d == dim] for dim in range(4)]
    s = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n" + names_text(m)
    s += "$Entities\n%d %d %d %d\n" % tuple(map(len, per))
    for dim in range(4):
        for g in per[dim]:
            s += "%d %s 1 %d%s\n" % (g, "0 0 0" if dim == 0 else "0 0 0 1 1 1", g, "" if dim == 0 else " 0")
    s += "$EndEntities\n$Nodes\n1 %d %d %d\n3 %d 0 %d\n" % (len(m.points), min(m.vertex_tag), max(m.vertex_tag), per[3][-1], len(m.points))
    s += "".join("%d\n" % t for t in m.vertex_tag) + "".join("%r %r %r\n" % tuple(p) for p in m.points)
    n = sum(len(e) for _, e in groups)
    tags = [t for _, e in groups for t, _ in e]
    s += "$EndNodes\n$Elements\n%d %d %d %d\n" % (len(groups), n, min(tags), max(tags))
    for (d, g, ty), es in groups:
        s += "%d %d %d %d\n" % (d, g, ty, len(es))
        s += "".join("%d %s\n" % (t, " ".join(map(str, vs))) for t, vs in es)
    return s + "$EndElements\n"


def msh4_binary(m):
    groups = blocks4(m)
    per = [[g for (d, g, _), _ in groups if d == dim] for dim in range(4)]
    b = b"$MeshFormat\n4.1 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n" + names_text(m).encode()
    b += b"$Entities\n" + struct.pack("<4Q", *map(len, per))
    for dim in range(4):
        for g in per[dim]:
            b += struct.pack("<i", g) + struct.pack("<%dd" % (3 if dim == 0 else 6), *([0.0] * 3 if dim == 0 else [0.0] * 3 + [1.0] * 3))
            b += struct.pack("<Qi", 1, g) + (b"" if dim == 0 else struct.pack("<Q", 0))
    b += b"\n$EndEntities\n$Nodes\n" + struct.pack("<4Q", 1, len(m.points), min(m.vertex_tag), max(m.vertex_tag))
    b += struct.pack("<3iQ", 3, per[3][-1], 0, len(m.points)) + struct.pack("<%dQ" % len(m.points), *m.vertex_tag)
    b += b"".join(struct.pack("<3d", *p) for p in m.points)
    tags = [t for _, e in groups for t, _ in e]
    b += b"\n$EndNodes\n$Elements\n" + struct.pack("<4Q", len(groups), len(tags), min(tags), max(tags))
    for (d, g, ty), es in groups:
        b += struct.pack("<3iQ", d, g, ty, len(es))
        b += b"".join(struct.pack("<%dQ" % (1 + len(vs)), t, *vs) for t, vs in es)
    return b + b"\n$EndElements\n"


def vtk(m):
    s = "# vtk DataFile Version 2.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS %d double\n" % len(m.points)
    s += "".join("%r %r %r\n" % tuple(p) for p in m.points)
    s += "CELLS %d %d\n" % (len(m.tets), 5 * len(m.tets)) + "".join("4 %d %d %d %d\n" % tuple(t) for t in m.tets)
    return s + "CELL_TYPES %d\n" % len(m.tets) + "10\n" * len(m.tets)


def vtk5(m, extra=True):
    """Writes version 5.1, text, like VTK 9: METADATA, a FIELD before the points, and a triangle among the tetrahedra."""
    cells = [(10, t) for t in m.tets]
    if extra:
        cells.insert(1, (5, m.tets[0][:3]))
    ends = [0]
    for _, c in cells:
        ends.append(ends[-1] + len(c))
    s = "# vtk DataFile Version 5.1\nvtk output\nASCII\nDATASET UNSTRUCTURED_GRID\n"
    s += "FIELD FieldData 2\nTimeValue 1 1 double\n0.5\nnames 1 1 string\nhello%20world\n" if extra else ""
    s += "POINTS %d double\n" % len(m.points) + "".join("%r %r %r\n" % tuple(p) for p in m.points)
    s += "METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1.7 \n\n" if extra else ""
    s += "CELLS %d %d\nOFFSETS vtktypeint64\n%s\n" % (len(ends), ends[-1], " ".join(map(str, ends)))
    s += "CONNECTIVITY vtktypeint64\n" + "".join(" ".join(map(str, c)) + "\n" for _, c in cells)
    return s + "CELL_TYPES %d\n" % len(cells) + "".join("%d\n" % t for t, _ in cells)


def vtk5_binary(m, real="double", whole="vtktypeint64"):
    """Writes version 5.1, binary (big endian), like VTK and meshio."""
    r, w = {"double": "d", "float": "f"}[real], {"vtktypeint64": "q", "vtktypeint32": "i"}[whole]
    flat = [x for p in m.points for x in p]
    corners = [v for t in m.tets for v in t]
    b = b"# vtk DataFile Version 5.1\nx\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS %d %s\n" % (len(m.points), real.encode())
    b += struct.pack(">%d%s" % (len(flat), r), *flat) + b"\nCELLS %d %d\nOFFSETS %s\n" % (len(m.tets) + 1, len(corners), whole.encode())
    b += struct.pack(">%d%s" % (len(m.tets) + 1, w), *range(0, len(corners) + 1, 4)) + b"\nCONNECTIVITY %s\n" % whole.encode()
    b += struct.pack(">%d%s" % (len(corners), w), *corners) + b"\nCELL_TYPES %d\n" % len(m.tets)
    return b + struct.pack(">%di" % len(m.tets), *[10] * len(m.tets)) + b"\nCELL_DATA 1\n"


def medit(m):
    s = "MeshVersionFormatted 2\nDimension 3\nVertices\n%d\n" % len(m.points)
    s += "".join("%r %r %r 0\n" % tuple(p) for p in m.points)
    s += "Tetrahedra\n%d\n" % len(m.tets) + "".join("%d %d %d %d %d\n" % (*(v + 1 for v in t), r) for t, r in zip(m.tets, m.region))
    return s + "End\n"


def read_vtk(path):
    """Reads points and cells of the text .vtk that tm-mesh convert writes."""
    lines = path.read_text().split("\n")
    i = next(i for i, l in enumerate(lines) if l.startswith("POINTS"))
    n = int(lines[i].split()[1])
    points = [tuple(map(float, l.split())) for l in lines[i + 1:i + 1 + n]]
    i = next(i for i, l in enumerate(lines) if l.startswith("CELLS"))
    n = int(lines[i].split()[1])
    return points, [tuple(map(int, l.split()[1:])) for l in lines[i + 1:i + 1 + n]]


def run(program, *args, env=None, timeout=300):
    return subprocess.run([str(program), *map(str, args)], capture_output=True, text=True, timeout=timeout, env=env)
