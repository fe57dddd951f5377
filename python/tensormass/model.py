"""One interface to all models of an organ: dynamic, precomputed, hybrid."""
from __future__ import annotations

import ctypes
import os
import warnings
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _bind as c
from ._core import ArgumentError, DeformationWarning, Floats, Object, address, call, check, choice, floats, ints, lib, vector, view
from .instruments import Instrument, Pose, Reaction, contact_definition, fill, friction_definition, reaction_of
from .mesh import Mesh
from .patch import Patch
from .solve import File, Problem, Progress, Report, report_of
from .state import Stage, stages_of
from .tissue import FORM, PRECISION, Material, Surface, Tissue, deformation_of, surface_of
from .world import World

LOOSE = {"fall": c.TM_LOOSE_FALL, "removed": c.TM_LOOSE_REMOVE}


class Timing(NamedTuple):
    """Durations, fixed when the model is made."""

    frame_s: float
    dt_s: float  #: of a substep
    substeps: int  #: of a frame
    average: int  #: substeps at the frame's end over which reactions are averaged
    critical_s: float  #: guaranteed critical step
    critical_tet: int  #: tetrahedron that sets it


class Model(Object):
    """An organ with its supports and instruments, computed by one of three models. All have the same calls; an unsupported one raises ExcludedError.

    kind: "dynamic" (tensor/mass: mass, motion, everything cuttable), "precomputed" (quasi-static, no cutting) or "hybrid" (`dynamic` (T,) bool is
    tensor/mass and cuttable, the rest condensed). materials, region_material, fibres, precision, form, strain_smoothing, rotation: as for Tissue (then
    model.world.add_rotation()). supports: [(vertices (n,), value_m)], each value one number, (3,) or (n, 3), m. load_N: (V, 3). gravity_m_s2: (3,).
    instruments; contact, grasp: options of Contact and Grasp, grasp=None: no grasping. friction: (static, kinetic) of each instrument, None: frictionless.
    cut: {} or {"rate_1_s", "loose", "fade_s"}, None: no cutting. frame_s, step_s, step_fraction, average, damped, threads: tm_model_def. file: the cache
    of a precomputed or hybrid model. solve: solver, threads, cg_tolerance ... of Problem.
    """

    report: Optional[Report] = None  #: cost of a precomputed or hybrid model

    def __init__(self, mesh: Mesh, materials: Union[Material, Sequence[Material]], kind: str = "dynamic", *, region_material: Any = None,
                 fibres: Any = None, precision: str = "double", form: str = "best", supports: Sequence[Tuple[Any, Any]] = (), load_N: Any = None,
                 gravity_m_s2: Any = None, instruments: Sequence[Instrument] = (), contact: Optional[Dict[str, Any]] = None,
                 grasp: Optional[Dict[str, Any]] = None, friction: Optional[Sequence[Tuple[float, float]]] = None,
                 cut: Optional[Dict[str, Any]] = None, dynamic: Any = None, strain_smoothing: Union[bool, float] = False,
                 rotation: float = 0.0, file: File = None,
                 progress: Optional[Progress] = None, solve: Optional[Dict[str, Any]] = None, **options: Any) -> None:
        self.mesh = mesh
        d = lib.tm_model_def_default()
        fill(d, options)
        whole = Tissue.__new__(Tissue)
        whole._fill(mesh, materials, region_material, fibres, strain_smoothing, rotation)
        d.tissue = whole._definition
        d.tissue.form = choice(form, FORM, "form")
        kept: List[Any] = [whole, *self._supports(d, supports)]
        if load_N is not None:
            kept.append(floats(load_N, (mesh.vertex_count, 3), "load_N"))
            d.load_N = kept[-1].ctypes.data
        if gravity_m_s2 is not None:
            kept.append(vector(gravity_m_s2, "gravity_m_s2"))
            d.gravity_m_s2 = ctypes.addressof(kept[-1])
        kept += self._tools(d, instruments, contact, grasp, cut)
        if friction is not None:
            kept.append(friction_definition(friction, len(instruments)))
            d.friction = ctypes.addressof(kept[-1])
        if kind == "dynamic":
            d.tissue.precision = choice(precision, PRECISION, "precision")
        pointer = self._make(d, kind, dynamic, precision, file, progress, solve or {})
        self._own(pointer, lib.tm_model_destroy, [mesh])
        self._struct = c.tm_model.from_address(self._pointer)
        self.instrument_count: int = self._struct.instrument_count
        self.tissue: Tissue = Tissue._borrow(self._struct.tissue, mesh, self)
        #: None for models without a world; you may add stages to it
        self.world: Optional[World] = World._borrow(self._struct.world, self.tissue, self) if self._struct.world else None

    # --- the definition ---

    @staticmethod
    def _supports(d: Any, supports: Sequence[Tuple[Any, Any]]) -> List[Any]:
        dofs, values = [np.zeros(0, np.int32)], [np.zeros(0)]
        for vertices, value_m in supports:
            listed = ints(vertices, (-1,), "supports: vertices")
            dofs.append((3 * listed[:, None] + np.arange(3, dtype=np.int32)).ravel())
            values.append(np.broadcast_to(np.asarray(value_m, float), (len(listed), 3)).ravel())
        dof, value = np.concatenate(dofs).astype(np.int32), np.ascontiguousarray(np.concatenate(values))
        d.support_count, d.support_dof, d.support_m = len(dof), dof.ctypes.data, value.ctypes.data
        return [dof, value]

    @staticmethod
    def _tools(d: Any, instruments: Sequence[Instrument], contact: Optional[Dict[str, Any]], grasp: Optional[Dict[str, Any]],
               cut: Optional[Dict[str, Any]]) -> List[Any]:
        touch, listed = contact_definition(instruments, contact or {})
        hold, remove = lib.tm_grasp_def_default(), lib.tm_cut_def_default()
        fill(hold, grasp or {})
        given = dict(cut or {})
        if "loose" in given:
            given["loose"] = choice(given["loose"], LOOSE, "loose")
        fill(remove, given)
        d.contact = ctypes.addressof(touch) if instruments else None
        d.grasp = ctypes.addressof(hold) if grasp is not None else None
        d.cut = ctypes.addressof(remove) if cut is not None else None
        return [touch, listed, hold, remove]

    def _make(self, d: Any, kind: str, dynamic: Any, precision: str, file: File, progress: Optional[Progress], solve: Dict[str, Any]) -> Any:
        pointer = ctypes.c_void_p()
        if kind == "dynamic":
            call(lib.tm_model_dynamic, ctypes.byref(d), ctypes.byref(pointer))
            return pointer
        choice(kind, {"dynamic": 0, "precomputed": 1, "hybrid": 2}, "kind")
        hybrid = kind == "hybrid"
        how, report = (lib.tm_hybrid_def_default() if hybrid else lib.tm_precomputed_def_default()), c.tm_solve_report()
        asked = Problem.computed(progress, solve)
        how.problem, how.precision = asked._struct, choice(precision, PRECISION, "precision")
        how.file = None if file is None else os.fsencode(file)
        if hybrid:
            part = np.ascontiguousarray(np.zeros(0) if dynamic is None else dynamic, np.uint8)
            if part.shape != (self.mesh.tet_count,):
                raise ArgumentError(f"dynamic: has shape {part.shape}; give ({self.mesh.tet_count},)", c.TM_ERR_ARGUMENT)
            how.dynamic = part.ctypes.data
        made = lib.tm_model_hybrid if hybrid else lib.tm_model_precomputed
        asked._call(made, ctypes.byref(d), ctypes.byref(how), ctypes.byref(pointer), ctypes.byref(report))
        self.report = report_of(report)
        return pointer

    # --- frames ---

    @property
    def timing(self) -> Timing:
        """Lengths and counts of frames and substeps."""
        p = self._struct.timing
        return Timing(p.frame_s, p.dt_s, p.substeps, p.average, p.critical_s, p.critical_tet)

    def frame(self, poses: Sequence[Pose] = ()) -> List[Reaction]:
        """Advances one frame: moves every instrument to its pose. Returns the reactions, one an instrument. UnstableError: nothing has changed."""
        if len(poses) != self.instrument_count:
            raise ArgumentError(f"{len(poses)} poses for {self.instrument_count} instruments; give one each", c.TM_ERR_ARGUMENT)
        to = (c.tm_tool_pose * max(1, len(poses)))(*[p._c() for p in poses])
        status = lib.tm_model_frame(self, to if poses else None)
        if self.world is not None:
            self.world._raise_failed()
        check(status, sentence=f"a displacement or a force stopped being finite in the frame after {self.time_s:g} s; it has not happened: lower the "
              "step, or what drives the tissue")
        return [self.reaction(i) for i in range(self.instrument_count)]

    def set_pose(self, instrument: int, at: Pose) -> None:
        """Sets an instrument's pose at once, without a swept path."""
        lib.tm_model_set_pose(self, instrument, ctypes.byref(at._c()))

    def reaction(self, instrument: int = 0) -> Reaction:
        """Returns the reaction of the last frame, with stiffness once `patch` has been called."""
        return reaction_of(lib.tm_model_reaction(self, instrument))

    @property
    def surface(self) -> Surface:
        """Surface of the complete organ's active tetrahedra; get it again after a frame."""
        return surface_of(self, lib.tm_model_surface(self))

    @property
    def u_m(self) -> Floats:
        """(V, 3) displacements, m; inner vertices are 0 in the precomputed model. Get it again after a frame."""
        return view(self, lib.tm_model_displacement(self), (self.mesh.vertex_count, 3))

    @property
    def position_m(self) -> Floats:
        """(V, 3) rest + displacement, m: a copy."""
        return self.mesh.rest_m + self.u_m

    @property
    def time_s(self) -> float:
        """Simulated time, s."""
        return float(lib.tm_model_time_s(self))

    @property
    def alive_count(self) -> int:
        """Number of active tetrahedra of the complete organ."""
        return int(lib.tm_model_alive(self))

    @property
    def hash(self) -> int:
        """Hash of the state's bits."""
        return int(lib.tm_model_hash(self))

    # --- between frames ---

    def allow_patches(self, **options: Any) -> None:
        """Adds memory and a stage for patches and stiffness; call it once. Options: max_vertices, max_triangles, horizon_s ... (PatchBuilder)."""
        d = lib.tm_patch_def_default()
        fill(d, options)
        call(lib.tm_model_allow_patches, self, ctypes.byref(d))

    def patch(self, instrument: int = 0) -> Optional[Patch]:
        """Returns the instrument's patch; reactions carry its stiffness from now on. Returns None if no surface is near, columns are missing, or patches
        are not allowed."""
        made = Patch()
        return made if lib.tm_model_patch(self, instrument, ctypes.byref(made._struct)) else None

    def settle(self, tolerance: float = 1e-10, max_steps: int = 2000000) -> Tuple[Floats, Floats]:
        """Returns ((V, 3) displacements m, (V, 3) reactions of the supports on the tissue N) in equilibrium under supports and loads. Precomputed and
        hybrid models: without instruments."""
        d, result = lib.tm_settle_def_default(), c.tm_settle_result()
        d.tolerance, d.max_steps = tolerance, max_steps
        u, reaction = np.zeros((self.mesh.vertex_count, 3)), np.zeros((self.mesh.vertex_count, 3))
        call(lib.tm_model_settle, self, ctypes.byref(d), address(u), address(reaction), ctypes.byref(result))
        doubt = deformation_of(self.tissue, result.deformation).doubt
        if doubt:
            warnings.warn("at rest " + doubt, DeformationWarning, stacklevel=2)
        return u, reaction

    def snapshot(self) -> bytes:
        """Returns a snapshot from which a model of the same definition continues bit-identically."""
        size = lib.tm_model_snapshot_bytes(self)
        room = np.zeros((size + 7) // 8, np.uint64)
        call(lib.tm_model_save, self, address(room), size)
        return room.tobytes()[:size]

    @property
    def snapshot_bytes_max(self) -> int:
        """Upper bound of every later snapshot's size, bytes. Sizes change with contact, grasps and cuts."""
        return lib.tm_model_snapshot_bytes_max(self)

    def restore(self, snapshot: bytes) -> None:
        """Restores a snapshot. A damaged or foreign one raises and changes nothing."""
        room = np.zeros((len(snapshot) + 7) // 8, np.uint64)
        room.view(np.uint8)[:len(snapshot)] = np.frombuffer(snapshot, np.uint8)
        call(lib.tm_model_restore, self, address(room), len(snapshot))

    def start(self) -> None:
        """Starts a thread for background work, for real time."""
        call(lib.tm_model_start, self)

    @property
    def stages(self) -> List[Stage]:
        """The stages of a frame, in the order they run."""
        return stages_of(self, lib.tm_model_stages)

    def set_timing(self, on: bool = True) -> None:
        """Enables or disables timing of the stages."""
        lib.tm_model_set_timing(self, on)
