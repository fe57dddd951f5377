"""Tetrahedral meshes and the files that hold them."""
from __future__ import annotations

import ctypes
import os
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Union

import numpy as np

from . import _bind as c
from ._core import ArgumentError, Floats, Ints, Object, address, call, floats, ints, lib, view


class Quality(NamedTuple):
    """Quality of one tetrahedron at its rest positions."""

    volume_m3: float
    aspect: float  #: longest edge / (2 sqrt(6) inradius): 1 regular
    min_dihedral_rad: float
    max_dihedral_rad: float
    min_altitude_m: float


def _names(address: Any, count: int) -> List[str]:
    """Returns a C array of names, 64 bytes each, as a list."""
    return [ctypes.string_at(address + 64 * i).decode(errors="replace") for i in range(count)]


def _numbering(renumber: bool) -> int:
    return int(c.TM_NUMBERING_IMPROVED if renumber else c.TM_NUMBERING_ORIGINAL)


class Mesh(Object):
    """Rest positions and topology, constant once built. Cutting marks tetrahedra in the tissue; numbers never change.

    vertices: (V, 3) rest positions, m. tets: (T, 4) vertex indices of positive orientation, (p1-p0)x(p2-p0).(p3-p0) > 0; `orient` reverses the others.
    regions: (T,) region of each tetrahedron, from 0, or None: all 0. renumber: renumbers vertices if a large bandwidth makes steps slow
    (docs/performance.md, "Numbering"). All arrays of this mesh, and of objects made on it, are then in the mesh's own numbering; `original_vertex`,
    `to_original` and `from_original` convert. Tetrahedra keep their numbers.

    Raises MeshError with the `entity`: indices out of range, zero or negative volume, a face shared by three, a vertex without tetrahedra ... All arrays
    are read-only views of the library's memory.
    """

    #: named sets of vertices, (n,) each, of a mesh from a file
    groups: Dict[str, Ints]
    #: names of the regions, of a mesh from a file
    region_names: Sequence[str]

    def __init__(self, vertices: Any, tets: Any, regions: Any = None, orient: bool = False, renumber: bool = False) -> None:
        vertex = floats(vertices, (-1, 3), "vertices")
        tet = ints(tets, (-1, 4), "tets")
        region = None if regions is None else ints(regions, (len(tet),), "regions")
        if orient and len(tet) and tet.min() >= 0 and tet.max() < len(vertex):
            corner = vertex[tet]
            side = corner[:, 1:] - corner[:, :1]
            turned = np.linalg.det(side) < 0
            tet = tet.copy()
            tet[turned, 2:] = tet[turned, :1:-1]
        definition = lib.tm_mesh_def_default()
        definition.vertex_count, definition.vertex_m = len(vertex), vertex.ctypes.data
        definition.tet_count, definition.tet = len(tet), tet.ctypes.data
        definition.region = None if region is None else region.ctypes.data
        definition.renumber = _numbering(renumber)
        self._make(definition)

    def _make(self, definition: Any) -> None:
        pointer = ctypes.c_void_p()
        call(lib.tm_mesh_create, ctypes.byref(definition), ctypes.byref(pointer))
        self._own(pointer, lib.tm_mesh_destroy)
        self._read_struct()
        self.groups, self.region_names = {}, []

    def _read_struct(self) -> None:
        self._struct = c.tm_mesh.from_address(self._pointer)

    @classmethod
    def _borrow(cls, pointer: int, owner: Object) -> "Mesh":
        """Returns a mesh that belongs to `owner`."""
        mesh = cls.__new__(cls)
        mesh._own(pointer, None, [owner])
        mesh._read_struct()
        mesh.groups, mesh.region_names = {}, []
        return mesh

    @classmethod
    def read(cls, path: Union[str, "os.PathLike[str]"], scale: float = 1.0, renumber: bool = False) -> "Mesh":
        """Reads a mesh file: .msh (2.2, 4.1), .vtk, .mesh; lengths times `scale` (1e-3 for millimetres). Fills `groups` and `region_names`.

        renumber: as for Mesh; `groups` are in the mesh's numbering.
        """
        file = c.tm_mesh_file()
        call(lib.tm_mesh_file_load, os.fsencode(path), scale, ctypes.byref(file))
        try:
            pointer = ctypes.c_void_p()
            call(lib.tm_mesh_file_build_numbered, ctypes.byref(file), _numbering(renumber), ctypes.byref(pointer))
            mesh = cls.__new__(cls)
            mesh._own(pointer, lib.tm_mesh_destroy)
            mesh._read_struct()
            mesh.region_names = _names(file.region_name, file.region_count)
            begin = view(None, file.group_begin, (file.group_count + 1,), "int32")
            vertex = view(None, file.group_vertex, (int(begin[-1]) if file.group_count else 0,), "int32")
            inside = mesh._of_given()[vertex]
            mesh.groups = {name: np.sort(inside[a:b]) for name, a, b in zip(_names(file.group_name, file.group_count), begin, begin[1:])}
        finally:
            lib.tm_mesh_file_free(ctypes.byref(file))
        return mesh

    @classmethod
    def block(cls, size_m: Sequence[float], cells: Sequence[int], origin_m: Sequence[float] = (0.0, 0.0, 0.0)) -> "Mesh":
        """Makes a box of `cells` (nx, ny, nz) cubes of six tetrahedra each."""
        n = [int(k) for k in cells]
        axes = [origin_m[a] + size_m[a] * np.arange(n[a] + 1) / n[a] for a in range(3)]
        vertex = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        step = np.array([(n[1] + 1) * (n[2] + 1), n[2] + 1, 1])
        corner = np.stack(np.meshgrid(*[np.arange(k) for k in n], indexing="ij"), -1).reshape(-1, 3) @ step
        tets = []
        for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):  # along three axes, from corner to corner
            path = np.cumsum([0] + [int(step[a]) for a in order])
            tets.append(corner[:, None] + path)
        return cls(vertex, np.concatenate(tets), orient=True)

    vertex_count: int = property(lambda self: self._struct.vertex_count)  # type: ignore[assignment]
    tet_count: int = property(lambda self: self._struct.tet_count)  # type: ignore[assignment]
    edge_count: int = property(lambda self: self._struct.edge_count)  # type: ignore[assignment]
    region_count: int = property(lambda self: self._struct.region_count)  # type: ignore[assignment]

    @property
    def rest_m(self) -> Floats:
        """(V, 3) rest positions, m."""
        return view(self, self._struct.rest_m, (self.vertex_count, 3))

    @property
    def tets(self) -> Ints:
        """(T, 4) vertices."""
        return view(self, self._struct.tet, (self.tet_count, 4), "int32")

    @property
    def regions(self) -> Ints:
        """(T,) region of each tetrahedron."""
        return view(self, self._struct.region, (self.tet_count,), "int32")

    @property
    def edges(self) -> Ints:
        """(E, 2) vertices k < l, sorted."""
        return view(self, self._struct.edge, (self.edge_count, 2), "int32")

    @property
    def tet_neighbours(self) -> Ints:
        """(T, 4) tetrahedron across the face opposite local vertex i, -1 outside."""
        return view(self, self._struct.tet_neighbour, (self.tet_count, 4), "int32")

    @property
    def surface(self) -> Ints:
        """(S, 3) outer triangles, normals outward."""
        return view(self, self._struct.surface, (self._struct.surface_count, 3), "int32")

    @property
    def volume_m3(self) -> Floats:
        """(T,) volume of each tetrahedron, m3."""
        return view(self, self._struct.volume_m3, (self.tet_count,))

    @property
    def original_vertex(self) -> Optional[Ints]:
        """(V,) original number of each vertex; None if nothing was renumbered."""
        if not self._struct.original_vertex:
            return None
        return view(self, self._struct.original_vertex, (self.vertex_count,), "int32")

    def _of_given(self) -> Ints:
        """(V,) number in the mesh of each original one."""
        found = np.arange(self.vertex_count, dtype=np.int32)
        if self.original_vertex is not None:
            found[self.original_vertex] = np.arange(self.vertex_count, dtype=np.int32)
        return found

    def to_original(self, values: Any) -> Any:
        """Returns a copy of vertex values, (V, ...), in the original numbering."""
        return self._checked(values)[self._of_given()]

    def from_original(self, values: Any) -> Any:
        """Returns a copy of vertex values, (V, ...), in the mesh's numbering."""
        return np.array(self._checked(values) if self.original_vertex is None else self._checked(values)[self.original_vertex])

    def _checked(self, values: Any) -> Any:
        array = np.asarray(values)
        if array.ndim < 1 or len(array) != self.vertex_count:
            raise ArgumentError(f"values of shape {array.shape} for {self.vertex_count} vertices; give one row each", c.TM_ERR_ARGUMENT)
        return array

    def quality(self, tet: int) -> Quality:
        """Returns the quality of one tetrahedron."""
        if not 0 <= tet < self.tet_count:
            raise IndexError(tet)
        q = lib.tm_mesh_tet_quality(self, tet)
        return Quality(q.volume_m3, q.aspect, q.min_dihedral_rad, q.max_dihedral_rad, q.min_altitude_m)

    def near(self, point_m: Any, normal: Any, within_m: float = 1e-6) -> Ints:
        """Returns the vertices within a distance of the plane through `point_m` with this normal, ascending."""
        unit = np.asarray(normal, float)
        distance = (self.rest_m - np.asarray(point_m, float)) @ (unit / np.linalg.norm(unit))
        return np.flatnonzero(np.abs(distance) <= within_m).astype(np.int32)


def read_fibres(path: Union[str, "os.PathLike[str]"], tet_count: int) -> Floats:
    """Reads unit fibres (T, 3) from a CSV file with the columns tet,ax,ay,az."""
    fibre = np.zeros((tet_count, 3))
    call(lib.tm_fibres_load, os.fsencode(path), tet_count, address(fibre))
    return fibre


def memory_in_use() -> int:
    """Returns the bytes that the library's objects use in this process."""
    return int(lib.tm_memory_in_use())
