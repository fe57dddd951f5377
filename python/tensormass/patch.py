"""Patches: surface near a tool with its compliance, from which a controller computes forces between two samples."""
from __future__ import annotations

import ctypes
from typing import Any, Optional, Tuple

import numpy as np

from . import _bind as c
from ._core import Floats, Ints, Object, address, call, floats, inside, lib
from .instruments import Contact, _Part, fill
from .solve import ComplianceFactor
from .state import WorldState


class Patch:
    """Surface patch near a tool and its quasi-static compliance (tm_patch). Arrays are views of it."""

    def __init__(self, struct: Optional[c.tm_patch] = None) -> None:
        self._struct = struct if struct is not None else c.tm_patch()

    kind: int = property(lambda self: self._struct.kind, doc="1 estimated, 2 exact.")  # type: ignore[assignment]
    instrument: int = property(lambda self: self._struct.instrument)  # type: ignore[assignment]
    vertex_count: int = property(lambda self: self._struct.vertex_count)  # type: ignore[assignment]
    triangle_count: int = property(lambda self: self._struct.triangle_count)  # type: ignore[assignment]
    radius_m: float = property(lambda self: self._struct.radius_m)  # type: ignore[assignment]
    age: float = property(lambda self: self._struct.age,  # type: ignore[assignment]
                          doc="Relative difference of the compliance from that of the tangent, 0 or more (nonlinear law, rotation).")
    grasps: bool = property(lambda self: self._struct.grasps, doc="A grasper's hold is folded in.")  # type: ignore[assignment]

    @property
    def vertices(self) -> Ints:
        """(n,) vertex indices in the mesh."""
        return inside(self._struct, "vertex", (-1,))[:self.vertex_count]

    @property
    def triangles(self) -> Any:
        """(t, 3) into `vertices`, normals outward."""
        return inside(self._struct, "triangle", (-1, 3))[:self.triangle_count]

    @property
    def vertex_m(self) -> Floats:
        """(n, 3) positions without the contact of this tool, m."""
        return inside(self._struct, "vertex_m", (-1, 3))[:self.vertex_count]

    @property
    def rest_m(self) -> Floats:
        """(n, 3) rest positions, m."""
        return inside(self._struct, "rest_m", (-1, 3))[:self.vertex_count]

    @property
    def compliance_m_N(self) -> Floats:
        """(3n, 3n) displacement of component i per unit force on j, m/N. A copy: the struct stores the upper triangle."""
        n = 3 * self.vertex_count
        full = np.zeros((n, n))
        full[np.triu_indices(n)] = inside(self._struct, "compliance_m_N", (-1,))[:n * (n + 1) // 2]
        return full + np.triu(full, 1).T


class PatchBuilder(_Part):
    """The stage "patch": computes an instrument's patch and stiffness between frames.

    source: exact compliance (ComplianceFactor); None: conjugate gradients, a few iterations a step. Options (tm_patch_def): max_vertices (24),
    max_triangles (32), column_vertices, iterations, tolerance, horizon_s.
    """

    def __init__(self, world: WorldState, contact: Contact, source: Optional[ComplianceFactor] = None, **options: Any) -> None:
        super().__init__(world)
        definition = lib.tm_patch_def_default()
        if source is not None:
            given = lib.tm_compliance_factor_source(source)
            definition.source = ctypes.addressof(given)
            world._handle.outlived_by(source._handle)  # the world calls it
        fill(definition, options)
        call(lib.tm_stage_patch, world, contact, ctypes.byref(definition), ctypes.byref(self._handle))

    def compute(self, instrument: int = 0) -> Optional[Patch]:
        """Returns the instrument's patch; Contact.reaction then carries the stiffness. Returns None if columns are missing or no surface is near."""
        made = Patch()
        return made if lib.tm_patch_compute(self, instrument, ctypes.byref(made._struct)) else None

    @property
    def pending(self) -> int:
        """Number of columns that the patches need and that have not converged: call compute until it is 0."""
        return int(lib.tm_patch_pending(self))


class PatchSolver(Object):
    """Contact solved on a patch, as in the controller's ticks, but in double precision and to convergence."""

    def __init__(self) -> None:
        pointer = ctypes.c_void_p()
        call(lib.tm_patch_solver_create, ctypes.byref(pointer))
        self._own(pointer, lib.tm_patch_solver_destroy)

    def force(self, patch: Patch, tip_m: Any) -> Tuple[Floats, bool]:
        """Returns (equivalent tip force on the tool (3,), N; whether no row carries load at the patch's boundary)."""
        out, within = np.zeros(3), ctypes.c_bool()
        lib.tm_patch_force(self, ctypes.byref(patch._struct), address(floats(tip_m, (3,), "tip_m")), address(out), ctypes.byref(within))
        return out, within.value

    def stiffness(self, patch: Patch, tip_m: Any) -> Floats:
        """Returns the stiffness dF/dP (3, 3), N/m."""
        out = np.zeros((3, 3))
        lib.tm_patch_stiffness(self, ctypes.byref(patch._struct), address(floats(tip_m, (3,), "tip_m")), address(out))
        return out
