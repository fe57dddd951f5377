"""State and step: a tissue's displacements and the stages of a step. Instruments, patches and solvers use only this part of a World."""
from __future__ import annotations

import ctypes
import warnings
import weakref
from typing import Any, Callable, List, NamedTuple, Optional, Sequence, Tuple, Type, TypeVar

import numpy as np

from . import _bind as c
from ._core import ArgumentError, Bytes, DeformationWarning, Floats, Ints, Object, address, call, check, choice, field_type, floats, interrupt_noted, ints, lib, vector, view
from .tissue import Deformation, Tissue, deformation_of

PHASES = {"begin": c.TM_PHASE_BEGIN, "force": c.TM_PHASE_FORCE, "load": c.TM_PHASE_LOAD, "integrate": c.TM_PHASE_INTEGRATE,
          "constrain": c.TM_PHASE_CONSTRAIN, "end": c.TM_PHASE_END}
_PHASE_NAMES = {**{v: k for k, v in PHASES.items()}, c.TM_PHASE_ON_DEMAND: "on demand"}
_GUARD = "python-guard"
_World = TypeVar("_World", bound="WorldState")


class Stage(NamedTuple):
    """One line of `World.stages`."""

    name: str
    phase: str
    bytes: int
    runs: int
    seconds: float  #: of its own work, when timing is on


def stages_of(owner: Object, function: Any) -> List[Stage]:
    """Returns the times of a world's stages as the library reports them."""
    report = (c.tm_stage_report * c.TM_MAX_STAGES)()
    count = function(owner, report)
    return [Stage(r.name.decode(), _PHASE_NAMES[r.phase], r.bytes, r.runs, r.seconds) for r in report[:count]]


class Settled(NamedTuple):
    """Result of `World.settle`."""

    steps: int
    residual: float
    energy_J: float
    load_steps: int  #: load steps of supports and loads, for corotational tissue; else 0
    deformation: Deformation


class WorldState(Object):
    """The part of a World without instruments: state, step, loads, supports, laws of the tissue, snapshots. Create a World instead."""

    def __init__(self, tissue: Tissue, dt_s: float = 0.0, step_fraction: float = 0.9, damped: bool = True, threads: int = 1) -> None:
        definition = lib.tm_world_def_default()
        definition.tissue, definition.dt_s, definition.step_fraction, definition.damped = tissue._pointer, dt_s, step_fraction, damped
        definition.threads = threads
        pointer = ctypes.c_void_p()
        call(lib.tm_world_create, ctypes.byref(definition), ctypes.byref(pointer))
        self._own(pointer, lib.tm_world_destroy, [tissue])
        self._begin(tissue)

    def _begin(self, tissue: Tissue) -> None:
        self._tissue = tissue
        self._vertices = tissue.mesh.vertex_count
        self._state = c.tm_state.from_address(lib.tm_world_state(self))
        self._kept: List[Any] = []  # callbacks of its stages
        self._failed: Optional[BaseException] = None
        self._axes: Ints = np.zeros(0, np.int32)

    @classmethod
    def _borrow(cls: Type[_World], pointer: int, tissue: Tissue, owner: Object) -> _World:
        world = cls.__new__(cls)
        world._own(pointer, None, [owner])
        world._begin(tissue)
        return world

    # --- state ---

    tissue: Tissue = property(lambda self: self._tissue)  # type: ignore[assignment]

    def _array(self, pointer: Any, writable: bool = True) -> Floats:
        return view(self, pointer, (self._vertices, 3), writable=writable)

    @property
    def u_m(self) -> Floats:
        """(V, 3) displacements now, m."""
        return self._array(self._state.u_m)

    @property
    def u_prev_m(self) -> Floats:
        """(V, 3) displacements one step before, m. The velocity is (u_m - u_prev_m) / dt_s."""
        return self._array(self._state.u_prev_m)

    @property
    def u_next_m(self) -> Floats:
        """(V, 3) displacements of the next step, m, for a stage from "integrate" on."""
        return self._array(self._state.u_next_m)

    @property
    def force_N(self) -> Floats:
        """(V, 3) internal and external force of the last step, N. A "load" stage adds to it."""
        return self._array(self._state.force_N)

    @property
    def position_m(self) -> Floats:
        """(V, 3) rest + displacement, m: a copy."""
        return self._tissue.mesh.rest_m + self.u_m

    @property
    def mobility_s2_kg(self) -> Floats:
        """(V,) displacement within one step per force, 1/(m/dt2 + gamma/2dt), s2/kg; 0 without mass."""
        return view(self, lib.tm_world_mobility_s2_kg(self), (self._vertices,))

    time_s: float = property(lambda self: self._state.time_s, doc="Simulated, s.")  # type: ignore[assignment]
    steps: int = property(lambda self: self._state.step, doc="Substeps done.")  # type: ignore[assignment]

    @property
    def dt_s(self) -> float:
        """Length of a substep, s. A value above the guaranteed step raises StepError."""
        return float(lib.tm_world_step_s(self))

    @dt_s.setter
    def dt_s(self, value: float) -> None:
        call(lib.tm_world_set_step, self, value)

    @property
    def hash(self) -> int:
        """Hash of the bits of u_m and u_prev_m."""
        return int(lib.tm_world_hash(self))

    # --- stepping ---

    def step(self, count: int = 1) -> None:
        """Advances `count` substeps, all or none. After UnstableError, or an exception in a stage's function, the state is restored bit-identically."""
        status = lib.tm_world_step(self, count)
        self._raise_failed()
        check(status, sentence=f"a displacement passed {lib.tm_world_largest_displacement_m(self):g} m, or a force stopped being finite, within {count} steps "
              f"from {self.time_s:g} s; all is as before this call: lower the step (an own stage that makes tissue stiffer needs a step_limit_s), or "
              "what drives the tissue; to go back farther, restore a snapshot")

    def _raise_failed(self) -> None:
        """Raises the exception of a stage's function."""
        failed, self._failed = self._failed, None
        if failed is not None:
            raise failed

    def run(self, seconds: float) -> int:
        """Advances complete substeps up to this duration, in chunks between which Ctrl-C is noticed. Returns their number."""
        total = max(0, round(seconds / self.dt_s))
        for done in range(0, total, 1000):
            self.step(min(1000, total - done))
        return total

    def settle(self, tolerance: float = 1e-10, max_steps: int = 2000000, progress: Optional[Callable[[int, float], Any]] = None) -> Settled:
        """Solves for static equilibrium under supports and loads; contact stays active.

        Corotational and nonlinear tissue starts at the present state, or undeformed if a tenth of it is inverted, and advances in load steps; rotated supports turn round their axes by the shorter arc.
        tolerance: residual relative to forces, or to the stiffness times 1e-4 of the largest displacement if that is more. Rounding may prevent
        1e-11 and below. progress(step, residual): False stops; so does Ctrl-C. ConvergenceError: not reached, the state is unchanged.
        DeformationWarning: tetrahedra are inverted in equilibrium, or linear tissue is far outside its range."""
        definition, result = lib.tm_settle_def_default(), c.tm_settle_result()
        definition.tolerance, definition.max_steps = tolerance, max_steps
        raised: List[BaseException] = []
        stop: List[Any] = []

        def ask(user: Any, step: int, residual: float) -> bool:
            try:
                return not stop and self._failed is None and (progress is None or progress(step, residual) is not False)
            except BaseException as error:  # noqa: B902 (handed on below)
                raised.append(error)
                return False

        asked = field_type(c.tm_settle_def, "progress")(ask)
        definition.progress = asked
        try:
            with interrupt_noted() as stop:
                call(lib.tm_world_settle, self, ctypes.byref(definition), ctypes.byref(result))
        finally:
            self._raise_failed()
            if raised:
                raise raised[0]
        found = deformation_of(self._tissue, result.deformation)
        if found.doubt:
            warnings.warn("at rest " + found.doubt, DeformationWarning, stacklevel=2)
        return Settled(result.steps, result.residual, result.energy_J, result.load_steps, found)

    # --- stages ---

    @property
    def stages(self) -> List[Stage]:
        """The stages, in the order they run."""
        return stages_of(self, lib.tm_world_stages)

    def set_timing(self, on: bool = True) -> None:
        """Enables or disables timing of the stages."""
        lib.tm_world_set_timing(self, on)

    def remove_stage(self, name: str) -> None:
        """Removes a stage. Refused while another stage requires it: remove that one first."""
        call(lib.tm_world_remove_stage, self, name.encode())

    def add_stage(self, name: str, function: Callable[[Any], Any], phase: str = "load", before: Optional[str] = None,
                  step_limit_s: float = 0.0) -> None:
        """Adds your own effect: calls `function(world)` once a substep, in `phase` ("begin", "force", "load", "integrate", "constrain", "end").

        The function reads u_m, and adds to force_N ("load") or corrects u_next_m ("constrain"). If it raises, the step raises the same exception
        and the state is unchanged. Snapshots do not contain data of the function's own.

        step_limit_s: longest step that is stable with the effect; a longer dt_s raises StepError. 0: no limit, correct for forces that do not
        grow with u_m. For springs of k[v] N/m on vertices of mass m[v]: (1 / tissue.critical_step()[0]**2 + (k / (4 * m)).max()) ** -0.5.
        """
        world = weakref.ref(self)
        number = choice(phase, PHASES, "phase")

        def run(_self: Any, _world: Any) -> None:
            me = world()
            if me is None or me._failed is not None:
                return
            try:
                function(me)
            except BaseException as error:  # noqa: B902 (raised by step)
                me._failed = error
                if number >= c.TM_PHASE_CONSTRAIN:
                    me.u_next_m[:] = np.nan

        if not any(s.name == _GUARD for s in self.stages):
            self._add(_GUARD, self._guard(), c.TM_PHASE_END)
        self._add(name, run, number, before, step_limit_s)

    def _guard(self) -> Callable[[Any, Any], None]:
        """Fails the step if a function raised before the integrator: sets u_next_m to NaN, so that the library rolls back."""
        world = weakref.ref(self)

        def run(_self: Any, _world: Any) -> None:
            me = world()
            if me is not None and me._failed is not None:
                me.u_next_m[:] = np.nan

        return run

    def _add(self, name: str, function: Callable[[Any, Any], None], phase: int, before: Optional[str] = None, step_limit_s: float = 0.0) -> None:
        stage = c.tm_stage()
        run = field_type(c.tm_stage, "run")(function)
        spelled, other = name.encode(), before.encode() if before else None
        stage.size, stage.name, stage.phase, stage.run, stage.runs_before = ctypes.sizeof(stage), spelled, phase, run, other
        stage.step_limit_s = step_limit_s
        call(lib.tm_world_add_stage, self, ctypes.byref(stage), 0)
        self._kept += [run, spelled, other]

    def add_gravity(self, g_m_s2: Sequence[float] = (0.0, 0.0, -9.81)) -> None:
        """Adds weight. g (3,), m/s2."""
        call(lib.tm_stage_gravity, self, vector(g_m_s2, "g_m_s2"))

    def add_load(self, force_N: Any) -> None:
        """Adds constant forces on vertices, (V, 3) N, copied."""
        call(lib.tm_stage_load, self, address(floats(force_N, (self._vertices, 3), "force_N")))

    def add_pressure(self, triangles: Any, pressure_Pa: Any) -> None:
        """Adds pressures that follow the deformed surface: `triangles` (n,), indices into mesh.surface, bear `pressure_Pa`, one number or (n,), Pa, along
        their inward normals and over their deformed area. All of them in one call: one pressure stage a world. Of a triangle that is listed twice the
        pressures add. ArgumentError: no such triangle, or a pressure that is not finite."""
        listed = ints(triangles, (-1,), "triangles")
        count = len(self._tissue.mesh.surface)
        if listed.size and (listed.min() < 0 or listed.max() >= count):
            raise ArgumentError(f"triangles: has indices outside 0 to {count - 1} of mesh.surface", c.TM_ERR_ARGUMENT)
        pressure = np.zeros(count)
        np.add.at(pressure, listed, np.broadcast_to(np.asarray(pressure_Pa, float), (len(listed),)))
        call(lib.tm_stage_pressure, self, address(pressure))

    def traction(self, triangles: Any, traction_Pa: Sequence[float]) -> Floats:
        """Returns forces (V, 3), N, for add_load: a traction (3,), Pa over rest area, on surface triangles (n, 3)."""
        listed, out = ints(triangles, (-1, 3), "triangles"), np.zeros((self._vertices, 3))
        if listed.size and (listed.min() < 0 or listed.max() >= self._vertices):
            raise ArgumentError(f"triangles: has vertices outside 0 to {self._vertices - 1}", c.TM_ERR_ARGUMENT)
        lib.tm_load_add_traction(self._tissue.mesh, address(listed), len(listed), vector(traction_Pa, "traction_Pa"), address(out))
        return out

    def add_support(self, vertices: Any, value_m: Any = 0.0, axes: str = "xyz") -> None:
        """Prescribes displacements of `vertices` (n,) along these axes. value_m: one number, (3,) or (n, 3), m. One support stage a world."""
        listed = ints(vertices, (-1,), "vertices")
        held = ["xyz".index(a) for a in axes]
        value = np.broadcast_to(np.asarray(value_m, float), (len(listed), 3))[:, held]
        dof = (3 * listed[:, None] + np.array(held, np.int32)).astype(np.int32)
        self.add_support_components(dof.ravel(), np.ascontiguousarray(value).ravel())

    def add_support_components(self, dof: Any, value_m: Any) -> None:
        """Prescribes components: u.flat[dof[i]] = value_m[i], both (n,); dof = 3*vertex + axis."""
        listed = ints(dof, (-1,), "dof")
        value = floats(value_m, (len(listed),), "value_m")
        definition = lib.tm_support_def_default()
        definition.count, definition.dof, definition.value_m = len(listed), listed.ctypes.data, value.ctypes.data
        call(lib.tm_stage_support, self, ctypes.byref(definition))
        self._axes = listed

    def move_support(self, component: int, value_m: float) -> None:
        """Moves one component of the support's list to `value_m` (order of add_support: by vertex, then axis)."""
        lib.tm_support_move(self, component, value_m)

    @property
    def support_components(self) -> Ints:
        """(n,) 3*vertex + axis of each component of the support, in the order of move_support."""
        return self._axes

    @property
    def support_reaction_N(self) -> Floats:
        """(V, 3) force of the support on the tissue at the last step, N; zero elsewhere."""
        out = np.zeros((self._vertices, 3))
        lib.tm_support_reaction(self, address(out))
        return out

    @property
    def support_mask(self) -> Bytes:
        """(V, 3) 1 where a component is prescribed."""
        out = np.zeros((self._vertices, 3), np.uint8)
        lib.tm_support_mask(self, address(out))
        return out

    @property
    def limited_tets(self) -> int:
        """Number of tetrahedra that the last step, or settling, found beyond a limit of their nonlinear law (docs/nonlinear-laws.md)."""
        return int(lib.tm_world_limited_tets(self))

    @property
    def unstable_share(self) -> float:
        """Share of the rest volume in which the nonlinear law has lost its ellipticity at u_m, so that the solution depends on the mesh."""
        return float(lib.tm_world_unstable_share(self))

    def check_constrained(self) -> None:
        """Raises SupportError with a vertex if a connected piece has a free rigid motion."""
        call(lib.tm_world_check_constrained, self)

    def add_rotation(self) -> None:
        """Makes the tissue corotational, so that large rotations keep its law. Needs a Tissue with rotation > 0."""
        call(lib.tm_stage_rotation, self, None)

    def add_viscosity(self, terms: "Sequence[Tuple[float, float, float]]") -> None:
        """Adds viscosity: one to three (time_s, share of the shear, share of the bulk modulus) of a Prony series. Call add_rotation first if both are
        needed."""
        definition = lib.tm_viscosity_def_default()
        definition.count = len(terms)
        for term, (time_s, shear, bulk) in zip(definition.term, terms):
            term.time_s, term.shear, term.bulk = time_s, shear, bulk
        call(lib.tm_stage_viscosity, self, ctypes.byref(definition))

    def add_energy(self) -> None:
        """Adds the energy account that `energy` reads."""
        call(lib.tm_stage_energy, self)

    @property
    def energy(self) -> c.tm_energy:
        """Energy account up to the last step, J: kinetic_J, elastic_J, contact_J[2], damping_J ... (tensormass/energy.h). Needs add_energy."""
        out = c.tm_energy()
        call(lib.tm_world_energy, self, ctypes.byref(out))
        return out

    # --- snapshots ---

    def snapshot(self) -> bytes:
        """Returns a snapshot from which the world continues bit-identically: state, active tetrahedra, contact, grasps."""
        room = np.empty((lib.tm_snapshot_bytes(self) + 7) // 8, np.uint64)
        size = lib.tm_snapshot_bytes(self)
        call(lib.tm_snapshot_save, self, address(room), size)
        return room.tobytes()[:size]

    @property
    def snapshot_bytes_max(self) -> int:
        """Upper bound of later snapshots' sizes with the present stages, bytes. Sizes change with contact, grasps and cuts."""
        return lib.tm_snapshot_bytes_max(self)

    def restore(self, snapshot: bytes) -> None:
        """Restores a snapshot of a world set up the same way. FileError: damaged; ArgumentError: of another world; both leave this one unchanged."""
        room = np.zeros((len(snapshot) + 7) // 8, np.uint64)
        room.view(np.uint8)[:len(snapshot)] = np.frombuffer(snapshot, np.uint8)
        call(lib.tm_snapshot_restore, self, address(room), len(snapshot))
