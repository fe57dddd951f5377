"""Writes VTK's XML files like VTK and meshio: text, base64 or raw after the XML, uncompressed or with zlib."""
import base64
import struct
import zlib

import numpy as np

KINDS = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}


class Writer:
    def __init__(self, how="ascii", packed=False, wide=True, big=False, base64_appended=False, block=1000):
        self.how, self.packed, self.wide, self.big, self.base64_appended, self.block = how, packed, wide, big, base64_appended, block
        self.tail = b""

    def header(self, *numbers):
        return struct.pack((">" if self.big else "<") + "%d%s" % (len(numbers), "Q" if self.wide else "I"), *numbers)

    def parts(self, data):
        """Encodes the parts one after the other."""
        if not self.packed:
            return [self.header(len(data)) + data]
        blocks = [data[i:i + self.block] for i in range(0, len(data), self.block)]
        small = [zlib.compress(b) for b in blocks]
        last = len(blocks[-1]) % self.block if blocks else 0
        return [self.header(len(blocks), self.block, last, *map(len, small)), b"".join(small)]

    def array(self, name, values, kind, components=1):
        values = np.asarray(values)
        tag = f'<DataArray type="{KINDS[kind]}" Name="{name}" NumberOfComponents="{components}" format="{self.how}"'
        if self.how == "ascii":
            return f"{tag}>\n{' '.join(map(repr, values.ravel().tolist()))}\n</DataArray>\n"
        parts = self.parts(values.astype((">" if self.big else "<") + kind).tobytes())
        text = b"".join(base64.b64encode(p) for p in parts)
        if self.how == "binary":
            return f"{tag}>\n{text.decode()}\n</DataArray>\n"
        at = len(self.tail)
        self.tail += text if self.base64_appended else b"".join(parts)
        return f'{tag} offset="{at}"/>\n'

    def file(self, kind, piece, body):
        text = f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="{"Big" if self.big else "Little"}Endian"'
        text += f' header_type="UInt{64 if self.wide else 32}"' + (' compressor="vtkZLibDataCompressor"' if self.packed else "") + f">\n<{kind}>\n<Piece {piece}>\n{body}</Piece>\n</{kind}>\n"
        out = text.encode()
        if self.how == "appended":
            out += f'<AppendedData encoding="{"base64" if self.base64_appended else "raw"}">\n_'.encode() + self.tail + b"\n</AppendedData>\n"
        return out + b"</VTKFile>\n"


def cells(w, kinds, corners):
    ends = np.cumsum([len(c) for c in corners])
    return "<Cells>\n" + w.array("connectivity", [v for c in corners for v in c], "i8") + w.array("offsets", ends, "i4") + w.array("types", kinds, "u1") + "</Cells>\n"


def vtu(mesh, **how):
    """Writes the tetrahedra, after a triangle that a reader must skip."""
    w = Writer(**how)
    corners = [mesh.tets[0][:3], *mesh.tets]
    body = "<Points>\n" + w.array("Points", mesh.points, "f8", 3) + "</Points>\n" + cells(w, [5] + [10] * len(mesh.tets), corners)
    body += "<CellData>\n" + w.array("region", [0, *(r - 1 for r in mesh.region)], "i4") + "</CellData>\n"
    return w.file("UnstructuredGrid", f'NumberOfPoints="{len(mesh.points)}" NumberOfCells="{len(corners)}"', body)


def surface_vtu(points, polygons, **how):
    w = Writer(**how)
    kind = {3: 5, 4: 9}
    body = "<Points>\n" + w.array("Points", points, "f4", 3) + "</Points>\n" + cells(w, [kind.get(len(p), 7) for p in polygons], polygons)
    return w.file("UnstructuredGrid", f'NumberOfPoints="{len(points)}" NumberOfCells="{len(polygons)}"', body)


def vtp(points, polygons, **how):
    w = Writer(**how)
    body = "<Points>\n" + w.array("Points", points, "f4", 3) + "</Points>\n<Polys>\n"
    body += w.array("connectivity", [v for p in polygons for v in p], "i8") + w.array("offsets", np.cumsum([len(p) for p in polygons]), "i8") + "</Polys>\n"
    return w.file("PolyData", f'NumberOfPoints="{len(points)}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" NumberOfPolys="{len(polygons)}"', body)


def polydata(points, polygons, version=4):
    """Writes the legacy format, text."""
    s = f"# vtk DataFile Version {version}.0\nx\nASCII\nDATASET POLYDATA\nPOINTS {len(points)} float\n" + "".join("%r %r %r\n" % tuple(map(float, p)) for p in points)
    if version < 5:
        return s + f"POLYGONS {len(polygons)} {sum(len(p) + 1 for p in polygons)}\n" + "".join(" ".join(map(str, [len(p), *p])) + "\n" for p in polygons)
    ends = [0, *np.cumsum([len(p) for p in polygons]).tolist()]
    return s + f"POLYGONS {len(ends)} {ends[-1]}\nOFFSETS vtktypeint64\n{' '.join(map(str, ends))}\nCONNECTIVITY vtktypeint64\n" + "\n".join(" ".join(map(str, p)) for p in polygons) + "\n"
