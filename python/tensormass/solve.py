"""Static solutions, exact compliance, and the precomputed model by itself: libtensormass_solve with CHOLMOD."""
from __future__ import annotations

import ctypes
import os
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _bind as c
from ._core import ArgumentError, Floats, Ints, Object, address, call, choice, field_type, fields, floats, ints, lib, view
from .instruments import HELD, Instrument, Pose, Reaction, contact_definition, fill, reaction_of, rows_of
from .tissue import PRECISION, Tissue
from .state import WorldState

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the library has threads of its own, with one OpenBLAS thread in each

SOLVERS = {"cholesky": c.TM_SOLVER_CHOLESKY, "cg": c.TM_SOLVER_CG}
Progress = Callable[[str, float, float], Any]
File = Union[str, "os.PathLike[str]", None]


class Report(NamedTuple):
    """Cost of a solution or of a model."""

    free_dofs: int
    columns: int
    interface_dofs: int
    columns_found: int  #: columns that an earlier, unfinished run computed (resume)
    factor_bytes: int
    responses_bytes: int
    work_bytes: int
    order_s: float
    factor_s: float
    columns_s: float
    seconds: float
    from_file: bool
    why: str  #: why a file was not used


def report_of(r: c.tm_solve_report) -> Report:
    """Returns a tm_solve_report in Python's types."""
    values = {n: getattr(r, n) for n in fields(r)}
    values["why"] = values["why"].decode()
    return Report(**values)


class Problem:
    """Static problem K u = f with prescribed components, for the active tetrahedra of a tissue.

    fixed: (V, 3) bool. fixed_value_m: (V, 3) read where fixed; None: all 0. load_N: (V, 3) constant forces, gravity included. solver: "cholesky" or "cg".
    progress(what, fraction, seconds_left) may return False to stop. Options (tm_solve_def): cg_tolerance, cg_max_iterations, threads (0: all cores;
    results are bit-identical), memory_limit_bytes.
    """

    def __init__(self, tissue: Tissue, fixed: Any, fixed_value_m: Any = None, load_N: Any = None, solver: str = "cholesky",
                 progress: Optional[Progress] = None, **options: Any) -> None:
        shape = (tissue.mesh.vertex_count, 3)
        self.tissue = tissue
        mask = np.ascontiguousarray(fixed, np.uint8)
        if mask.shape != shape:
            raise ArgumentError(f"fixed: has shape {mask.shape}; give {shape}", c.TM_ERR_ARGUMENT)
        value = None if fixed_value_m is None else floats(fixed_value_m, shape, "fixed_value_m")
        load = None if load_N is None else floats(load_N, shape, "load_N")
        self._how(solver, progress, options)
        d = self._struct
        d.tissue, d.fixed = tissue._pointer, mask.ctypes.data
        d.fixed_value_m = None if value is None else value.ctypes.data
        d.load_N = None if load is None else load.ctypes.data
        self._kept = (mask, value, load)

    @classmethod
    def computed(cls, progress: Optional[Progress], options: Dict[str, Any]) -> "Problem":
        """Makes a problem of the solver's options only, for Model."""
        problem = cls.__new__(cls)
        problem._how(options.get("solver", "cholesky"), progress, {k: v for k, v in options.items() if k != "solver"})
        return problem

    def _how(self, solver: str, progress: Optional[Progress], options: Dict[str, Any]) -> None:
        d = lib.tm_solve_def_default()
        fill(d, options)
        d.solver = choice(solver, SOLVERS, "solver")
        self._raised: List[BaseException] = []

        def ask(user: Any, what: bytes, fraction: float, seconds_left: float) -> bool:
            try:
                return progress is None or progress(what.decode(), fraction, seconds_left) is not False
            except BaseException as error:  # noqa: B902 (handed on by _call)
                self._raised.append(error)
                return False

        asked = field_type(c.tm_solve_def, "progress")(ask)
        if progress is not None:
            d.progress = asked
        self._struct, self._asked = d, asked

    def _call(self, function: Any, *arguments: Any) -> None:
        self._raised.clear()
        try:
            call(function, *arguments)
        finally:
            if self._raised:
                raise self._raised[0]

    @classmethod
    def of_world(cls, world: WorldState, load_N: Any = None, **options: Any) -> "Problem":
        """Makes a problem of a world's present supports and these loads."""
        mask = world.support_mask
        return cls(world.tissue, mask, np.where(mask, world.u_m, 0.0), load_N, **options)

    def solve(self) -> Tuple[Floats, Floats, Report]:
        """Returns ((V, 3) displacements m, (V, 3) reactions of the supports on the tissue N, report)."""
        shape = (self.tissue.mesh.vertex_count, 3)
        u, reaction, report = np.zeros(shape), np.zeros(shape), c.tm_solve_report()
        self._call(lib.tm_solve_static, ctypes.byref(self._struct), address(u), address(reaction), ctypes.byref(report))
        return u, reaction, report_of(report)


def solve_static(tissue: Tissue, fixed: Any, fixed_value_m: Any = None, load_N: Any = None, **options: Any) -> Tuple[Floats, Floats, Report]:
    """Returns ((V, 3) displacements m, (V, 3) reactions N, report) of the static Problem, with its options."""
    return Problem(tissue, fixed, fixed_value_m, load_N, **options).solve()


class ComplianceFactor(Object):
    """Exact compliance for the patches of the dynamic model, cut or uncut: World.add_patch(contact, source).

    fixed: (V, 3) bool, prescribed components (World.support_mask).
    """

    def __init__(self, tissue: Tissue, fixed: Any) -> None:
        mask = np.ascontiguousarray(fixed, np.uint8)
        if mask.shape != (tissue.mesh.vertex_count, 3):
            raise ArgumentError(f"fixed: has shape {mask.shape}; give ({tissue.mesh.vertex_count}, 3)", c.TM_ERR_ARGUMENT)
        d = lib.tm_compliance_factor_def_default()
        d.tissue, d.fixed = tissue._pointer, mask.ctypes.data
        pointer = ctypes.c_void_p()
        call(lib.tm_compliance_factor_create, ctypes.byref(d), ctypes.byref(pointer))
        self._own(pointer, lib.tm_compliance_factor_destroy, [tissue])

    def start(self) -> None:
        """Starts a thread that computes from now on."""
        call(lib.tm_compliance_factor_start, self)


class Precomputed(Object):
    """The precomputed model by itself, for imposed displacements (as in the paper) or updates at your own rate; otherwise use Model(kind="precomputed").
    Quasi-static, no cutting. Computes the surface's responses once and stores them in `file` if one is given.

    Options (tm_precomputed_def): update_s (0.002), max_contact_vertices (256), resume (False; True continues a killed run's columns). contact, grasp:
    dicts of the options of Contact and Grasp.
    """

    def __init__(self, problem: Problem, instruments: Sequence[Instrument] = (), file: File = None, precision: str = "double",
                 contact: Optional[Dict[str, Any]] = None, grasp: Optional[Dict[str, Any]] = None, **options: Any) -> None:
        d, report, pointer = lib.tm_precomputed_def_default(), c.tm_solve_report(), ctypes.c_void_p()
        fill(d, options)
        d.problem, d.precision = problem._struct, choice(precision, PRECISION, "precision")
        d.file = None if file is None else os.fsencode(file)
        touch, _listed = contact_definition(instruments, contact or {})
        hold = lib.tm_grasp_def_default()
        fill(hold, grasp or {})
        if instruments:
            d.contact = ctypes.addressof(touch)
        if grasp is not None:
            d.grasp = ctypes.addressof(hold)
        problem._call(lib.tm_precomputed_create, ctypes.byref(d), ctypes.byref(pointer), ctypes.byref(report))
        self._own(pointer, lib.tm_precomputed_destroy, [problem.tissue])
        self.tissue, self.report, self.instrument_count = problem.tissue, report_of(report), len(instruments)

    def update(self, poses: Sequence[Pose]) -> int:
        """Moves every instrument to its pose and solves contact. Returns the Newton steps of the last increment, negative if it did not converge."""
        if len(poses) != self.instrument_count:
            raise ArgumentError(f"{len(poses)} poses for {self.instrument_count} instruments; give one each", c.TM_ERR_ARGUMENT)
        listed = (c.tm_tool_pose * max(1, len(poses)))(*[p._c() for p in poses])
        return int(lib.tm_precomputed_update(self, listed))

    def set_pose(self, instrument: int, at: Pose) -> None:
        """Sets the instrument's pose at once."""
        lib.tm_precomputed_set_pose(self, instrument, ctypes.byref(at._c()))

    def pose(self, instrument: int = 0) -> Pose:
        """Returns the instrument's pose."""
        return Pose._of(lib.tm_precomputed_pose(self, instrument))

    def force(self, instrument: int = 0) -> Floats:
        """Returns the equivalent tip force (3,) on the tool at the last update, N."""
        out = np.zeros(3)
        lib.tm_precomputed_force(self, instrument, address(out))
        return out

    def reaction(self, instrument: int = 0) -> Reaction:
        """Returns the reaction at the last update, with its stiffness (costs a few updates)."""
        return reaction_of(lib.tm_precomputed_reaction(self, instrument))

    @property
    def rows(self) -> Any:
        """Returns the contact rows (n,), as Contact.rows."""
        return rows_of(self, lib.tm_precomputed_rows)

    def vertices(self, instrument: int = 0) -> Tuple[Ints, str]:
        """Returns the vertices in the jaws, as Grasp.vertices."""
        vertex, state = ctypes.c_void_p(), ctypes.c_int()
        count = lib.tm_precomputed_grasped(self, instrument, ctypes.byref(vertex), ctypes.byref(state))
        return view(self, vertex.value, (count,), "int32").copy(), HELD[state.value]

    def impose(self, vertices: Any, u_m: Any, compliance_m_N: float = 0.0) -> None:
        """Imposes displacements (n, 3) on surface vertices (n,) from the next update on, as in the paper; without vertices: releases them."""
        listed = ints(vertices, (-1,), "vertices")
        u = floats(u_m, (len(listed), 3), "u_m")
        call(lib.tm_precomputed_impose, self, len(listed), address(listed), address(u), compliance_m_N)

    def imposed_force(self, i: int) -> Floats:
        """Returns the force (3,) of the i-th imposed vertex on the tissue, N."""
        out = np.zeros(3)
        lib.tm_precomputed_imposed_force(self, i, address(out))
        return out

    @property
    def u_m(self) -> Floats:
        """(V, 3) displacements on the surface, m; inner vertices 0."""
        return view(self, lib.tm_precomputed_displacement(self), (self.tissue.mesh.vertex_count, 3))

    @property
    def surface_vertices(self) -> Ints:
        """(n,) vertices that have responses, ascending."""
        vertex = ctypes.c_void_p()
        count = lib.tm_precomputed_surface(self, ctypes.byref(vertex))
        return view(self, vertex.value, (count,), "int32")

    @property
    def bytes(self) -> int:
        """Memory it uses, bytes."""
        return int(lib.tm_precomputed_bytes(self))
