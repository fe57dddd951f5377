"""Bodies of one mesh: contact of tissue with tissue, and ties between surfaces (docs/bodies.md)."""
from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from . import _bind as c
from ._core import ArgumentError, Bytes, Floats, Ints, address, call, fields, inside, ints, lib, vector
from .instruments import _Part, fill
from .mesh import Mesh
from .state import WorldState


class TouchReport(NamedTuple):
    """Contact of tissue with tissue in the last substep."""

    rows: int
    candidates: int  #: pairs of features that are close
    gathers: int  #: searches of the complete surface since the stage was added
    overflowed: bool  #: rows or candidates were dropped since the stage was added
    deepest_m: float  #: deepest overlap of two surfaces, m; 0: they did not cross


class Touch(_Part):
    """Contact of bodies with each other and with themselves. Add it after contact, if there is any.

    bodies: (T,) body of each tetrahedron, from 0; None: one body. pairs: the pairs (a, b) of bodies that touch, a == b for a body that touches itself; None:
    all. friction: (static, kinetic). Options (tm_touching_def): thickness_m (0.5e-3), compliance_m_N (0.5e-3), sweeps (10), max_rows (4096),
    max_candidates (65,536), force_cap_N (50). ArgumentError: a value outside its range.
    """

    def __init__(self, world: WorldState, bodies: Any = None, pairs: Optional[Sequence[Tuple[int, int]]] = None,
                 friction: Tuple[float, float] = (0.0, 0.0), **options: Any) -> None:
        super().__init__(world)
        tets = world.tissue.mesh.tet_count
        body = None if bodies is None else ints(bodies, (tets,), "bodies")
        count = 1 if body is None else int(body.max()) + 1
        definition = lib.tm_touching_def_default()
        own = ("body_count", "tet_body", "pair", "mu_static", "mu_kinetic")
        if set(own) & set(options):
            raise ArgumentError("%s: give bodies, pairs and friction instead" % ", ".join(sorted(set(own) & set(options))), c.TM_ERR_ARGUMENT)
        fill(definition, options)
        pair = _pair_table(pairs, count)
        definition.body_count, definition.tet_body = count, None if body is None else body.ctypes.data
        definition.pair = None if pair is None else pair.ctypes.data
        definition.mu_static, definition.mu_kinetic = friction
        call(lib.tm_stage_touch, world, ctypes.byref(definition), ctypes.byref(self._handle))

    @property
    def rows(self) -> Any:
        """Returns the rows (n,) of the last substep, a copy: a structured array with the fields of tm_touching_row: edges, vertex (4,), weight (4,), normal
        (3,), thickness_m, gap_m, lambda_N, across_N (3,) ... Vertex j bears weight[j] * (lambda_N * normal + across_N), N."""
        pointer = ctypes.c_void_p()
        count = lib.tm_touching_rows(self, ctypes.byref(pointer))
        if not count:
            return np.zeros(0, np.dtype(c.tm_touching_row))
        return np.frombuffer((c.tm_touching_row * count).from_address(pointer.value or 0), np.dtype(c.tm_touching_row)).copy()

    @property
    def force_N(self) -> Floats:
        """(V, 3) force of the last substep's contact on each vertex, N."""
        rows, out = self.rows, np.zeros((self.world.tissue.mesh.vertex_count, 3))
        pushed = rows["lambda_N"][:, None] * rows["normal"] + rows["across_N"]
        np.add.at(out, rows["vertex"], rows["weight"][:, :, None] * pushed[:, None])
        return out

    @property
    def report(self) -> TouchReport:
        """Counts and the deepest overlap of the last substep."""
        said = lib.tm_touching_get_report(self)
        return TouchReport(*(getattr(said, name) for name in fields(said)))


def _pair_table(pairs: Optional[Sequence[Tuple[int, int]]], count: int) -> Optional[Bytes]:
    """Returns the symmetric table (count, count) of pairs that touch."""
    if pairs is None:
        return None
    table = np.zeros((max(count, 1), max(count, 1)), np.uint8)
    for a, b in pairs:
        if not (0 <= a < count and 0 <= b < count):
            raise ArgumentError(f"pairs: ({a}, {b}) names no two of {count} bodies; give 0 to {count - 1}", c.TM_ERR_ARGUMENT)
        table[a, b] = table[b, a] = 1
    return table


@dataclass
class Tie:
    """A spring that pulls and never pushes, from a vertex to a point of another surface."""

    vertex: int
    other: Any  #: (3,) vertices of the triangle at whose point it ends
    weight: Any  #: (3,) barycentric, sum 1
    rest_m: float  #: length up to which it is slack, m
    stiffness_N_m: float
    break_N: float = 0.0  #: breaking load, N; 0: none

    @classmethod
    def to_nearest(cls, mesh: Mesh, vertex: int, triangles: Any, stiffness_N_m: float, break_N: float = 0.0) -> Optional["Tie"]:
        """Returns the tie from a vertex to the nearest point, at rest, of `triangles` (n, 3), slack up to that distance. None: each triangle has the
        vertex. ArgumentError: a vertex outside the mesh."""
        listed = ints(triangles, (-1, 3), "triangles")
        outside = not 0 <= vertex < mesh.vertex_count or (listed.size and (listed.min() < 0 or listed.max() >= mesh.vertex_count))
        if outside:
            raise ArgumentError(f"vertex or triangles: outside 0 to {mesh.vertex_count - 1}", c.TM_ERR_ARGUMENT)
        tie = c.tm_tie()
        if not lib.tm_tie_lead(mesh, vertex, address(listed), len(listed), ctypes.byref(tie)):
            return None
        return cls(vertex, list(tie.other), inside(tie, "weight", (3,)), tie.rest_m, stiffness_N_m, break_N)

    def _c(self) -> c.tm_tie:
        other = ints(self.other, (3,), "other")
        return c.tm_tie(self.vertex, (ctypes.c_int32 * 3)(*other), vector(self.weight, "weight"), self.rest_m, self.stiffness_N_m, self.break_N)


class Ties(_Part):
    """Ligaments and fat between bodies: one list of Tie a world. Add it after contact, if there is any.

    Options (tm_ties_def): sweeps (10; with contact, contact's). ArgumentError: a tie whose ends are not in the tissue, or a value outside its range.
    """

    def __init__(self, world: WorldState, ties: Sequence[Tie], **options: Any) -> None:
        super().__init__(world)
        listed = (c.tm_tie * max(1, len(ties)))(*[tie._c() for tie in ties])
        definition = lib.tm_ties_def_default()
        if {"count", "tie"} & set(options):
            raise ArgumentError("count, tie: give the list of ties instead", c.TM_ERR_ARGUMENT)
        fill(definition, options)
        definition.count, definition.tie = len(ties), ctypes.addressof(listed)
        call(lib.tm_stage_ties, world, ctypes.byref(definition), ctypes.byref(self._handle))

    def __len__(self) -> int:
        return int(lib.tm_ties_count(self))

    @property
    def whole(self) -> Any:
        """(n,) bool: neither broken nor cut."""
        return np.array([lib.tm_ties_is_whole(self, i) for i in range(len(self))], bool)

    @property
    def force_N(self) -> Floats:
        """(n,) tension of each tie in the last substep, N; 0 if it is gone."""
        return np.array([lib.tm_ties_force_N(self, i, None, None) for i in range(len(self))])

    @property
    def ends_m(self) -> Floats:
        """(n, 2, 3) both ends of each tie now, m: its vertex, and its point of the other surface."""
        out = np.zeros((len(self), 2, 3))
        for i in range(len(self)):
            lib.tm_ties_force_N(self, i, ctypes.c_void_p(out[i, 0].ctypes.data), ctypes.c_void_p(out[i, 1].ctypes.data))
        return out

    def fetch_cut(self) -> Tuple[Ints, Ints]:
        """Returns ((n,) ties that went since the last call, (n,) instrument that cut each; -1: its load broke it, -2: the tissue at an end went). In a
        Scene each frame has fetched them: see `whole`."""
        which, why = np.empty(len(self), np.int32), np.empty(len(self), np.int32)
        count = lib.tm_ties_fetch_cut(self, address(which), address(why), len(self))
        return which[:count].copy(), why[:count].copy()
