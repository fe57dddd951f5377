"""Instruments: contact, grasping, cutting."""
from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple, Type, TypeVar

import numpy as np

from . import _bind as c
from ._core import ArgumentError, Floats, Ints, address, call, choice, fields, floats, inside, lib, vector, view
from .state import WorldState

MODES = {"probe": c.TM_TOOL_PROBE, "grasper": c.TM_TOOL_GRASPER, "cautery": c.TM_TOOL_CAUTERY}
FLAGS: Dict[int, str] = {
    c.TM_REACTION_CAPPED: "capped", c.TM_REACTION_OVERFLOWED: "overflowed", c.TM_REACTION_UNCONVERGED: "unconverged",
    c.TM_REACTION_REPEATED: "repeated", c.TM_REACTION_UNSTABLE: "unstable", c.TM_REACTION_TOO_FAST: "too fast",
    c.TM_REACTION_INSIDE: "inside", c.TM_REACTION_RELEASING: "releasing",
}
HELD = {c.TM_GRASP_OPEN: "open", c.TM_GRASP_HOLDING: "holding", c.TM_GRASP_RELEASING: "releasing"}


@dataclass
class Pose:
    """Pose of an instrument. The shaft runs from the trocar through the tip, or along `direction` if the instrument is free; roll is about the shaft."""

    tip_m: Any  #: (3,) m, world
    roll_rad: float = 0.0
    grip: float = 0.0  #: 0 open to 1 closed
    active: bool = True  #: cautery: the current is on; probe: in the body
    direction: Any = (0.0, 0.0, -1.0)  #: (3,) of a free instrument: along the shaft, towards the tip

    def _c(self) -> c.tm_tool_pose:
        return c.tm_tool_pose(vector(self.tip_m, "tip_m"), self.roll_rad, self.grip, self.active, vector(self.direction, "direction"))

    @classmethod
    def _of(cls, pose: c.tm_tool_pose) -> "Pose":
        return cls(inside(pose, "tip_m", (3,)), pose.roll_rad, pose.grip, pose.active, inside(pose, "direction", (3,)))


@dataclass
class Instrument:
    """A tool at its first pose, in a trocar, or free (trocar_m None): the hand then turns its shaft."""

    trocar_m: Any  #: (3,) m, world: the pivot; None: free
    tip_m: Any  #: (3,) m, world, at the start
    mode: str = "probe"  #: "probe", "grasper", "cautery"
    radius_m: float = 0.0025  #: of shaft and tip, m
    contact_length_m: float = 0.1  #: length of shaft behind the tip that can touch, m
    roll_rad: float = 0.0
    grip: float = 0.0
    active: bool = True
    direction: Any = (0.0, 0.0, -1.0)  #: (3,) if free: along the shaft, towards the tip

    def _c(self) -> c.tm_instrument_def:
        pose = Pose(self.tip_m, self.roll_rad, self.grip, self.active, self.direction)._c()
        free = self.trocar_m is None
        trocar = vector((0.0, 0.0, 0.0) if free else self.trocar_m, "trocar_m")
        return c.tm_instrument_def(choice(self.mode, MODES, "mode"), free, trocar, self.radius_m, self.contact_length_m, pose)


class Reaction(NamedTuple):
    """Reaction of a frame on one instrument, averaged over the last substeps."""

    time_s: float  #: mean simulated time of the average, s
    tip_m: Floats  #: (3,) mean tip position, m
    force_N: Floats  #: (3,) equivalent tip force ON THE TOOL, N
    resultant_N: Floats  #: (3,) sum of row forces on the tool, N
    stiffness_N_m: Floats  #: (3, 3) dF/dP, N/m
    stiffness_kind: int  #: 0 none, 1 estimated, 2 exact
    row_count: int
    flags: int  #: bits; `flag_names` lists their names

    @property
    def flag_names(self) -> List[str]:
        """Names of the flags that are set."""
        return [name for bit, name in FLAGS.items() if self.flags & bit]


def reaction_of(r: c.tm_tool_reaction) -> Reaction:
    """Returns a tm_tool_reaction as arrays."""
    return Reaction(r.time_s, inside(r, "tip_m", (3,)), inside(r, "force_N", (3,)), inside(r, "resultant_N", (3,)),
                    inside(r, "stiffness_N_m", (3, 3)), r.stiffness_kind, r.row_count, r.flags)


def rows_of(owner: object, function: Any, contact: Any = None) -> Any:
    """Returns a structured array (n,) of tm_contact_row; `contact` if the owner itself has no function for them."""
    pointer = ctypes.c_void_p()
    count = function(contact or owner, ctypes.byref(pointer))
    if not count:
        return np.zeros(0, np.dtype(c.tm_contact_row))
    buffer = (c.tm_contact_row * count).from_address(pointer.value or 0)
    buffer._owner = owner
    return np.frombuffer(buffer, np.dtype(c.tm_contact_row))


def contact_definition(instruments: Sequence[Instrument], options: Dict[str, Any]) -> Tuple[c.tm_contact_def, Any]:
    """Returns a filled tm_contact_def and the objects that it points to."""
    listed = (c.tm_instrument_def * max(1, len(instruments)))(*[i._c() for i in instruments])
    definition = lib.tm_contact_def_default()
    definition.instrument_count, definition.instrument = len(instruments), ctypes.addressof(listed)
    fill(definition, options)
    return definition, listed


def fill(definition: Any, options: Dict[str, Any]) -> None:
    """Sets fields of a definition struct by name."""
    names = [n for n in fields(definition) if n not in ("cookie", "size")]
    for name, value in options.items():
        if name not in names:
            raise ArgumentError(f"option {name!r} is not known; use one of {', '.join(names)}", c.TM_ERR_ARGUMENT)
        setattr(definition, name, value)


_P = TypeVar("_P", bound="_Part")


class _Part:
    """Handle of a stage that the world owns."""

    def __init__(self, world: WorldState) -> None:
        self.world = world
        self._handle = ctypes.c_void_p()

    @classmethod
    def _of(cls: Type[_P], world: WorldState, handle: int) -> _P:
        """Returns the stage of this handle, which the world has already."""
        part = cls.__new__(cls)
        part.world, part._handle = world, ctypes.c_void_p(handle)
        return part

    @property
    def _as_parameter_(self) -> ctypes.c_void_p:
        return self._handle


class Contact(_Part):
    """Unilateral, frictionless contact of up to two instruments with the tissue's surface, regularised by a contact compliance.

    Options (tm_contact_def): contact_compliance_m_N (0.5e-3), sweeps (10), max_rows (256), force_cap_N (50).
    """

    def __init__(self, world: WorldState, instruments: Sequence[Instrument], **options: Any) -> None:
        super().__init__(world)
        self.instrument_count = len(instruments)
        definition, _listed = contact_definition(instruments, options)
        call(lib.tm_stage_contact, world, ctypes.byref(definition), ctypes.byref(self._handle))

    def set_target(self, instrument: int, to: Pose, substeps: int) -> None:
        """Sets the instrument's path over the next substeps: from its present pose to `to`, joint-linear about the trocar."""
        lib.tm_contact_set_target(self, instrument, ctypes.byref(to._c()), substeps)

    def set_pose(self, instrument: int, at: Pose) -> None:
        """Sets the pose at once, without a swept path."""
        lib.tm_contact_set_pose(self, instrument, ctypes.byref(at._c()))

    def pose(self, instrument: int = 0) -> Pose:
        """Returns the instrument's pose."""
        return Pose._of(lib.tm_contact_pose(self, instrument))

    def begin_frame(self, substeps: int, average: Optional[int] = None) -> None:
        """Begins a frame of `substeps`; the reaction averages the last `average` of them (default: a tenth)."""
        lib.tm_contact_begin_frame(self, substeps, max(1, substeps // 10) if average is None else average)

    def frame(self, poses: Sequence[Pose], substeps: int, average: Optional[int] = None) -> List[Reaction]:
        """Begins a frame, moves every instrument, steps the world, and returns the reactions."""
        self.begin_frame(substeps, average)
        for i, pose in enumerate(poses):
            self.set_target(i, pose, substeps)
        self.world.step(substeps)
        return [self.reaction(i) for i in range(self.instrument_count)]

    def reaction(self, instrument: int = 0) -> Reaction:
        """Returns the reaction of the present frame so far."""
        return reaction_of(lib.tm_contact_reaction(self, instrument))

    @property
    def rows(self) -> Any:
        """Returns the rows (n,) of the last substep, a structured array with the fields of tm_contact_row: face, vertex, normal, gap_m, lambda_N ... The
        view is valid until the next step."""
        return rows_of(self, lib.tm_contact_rows)


def friction_definition(coefficients: Sequence[Tuple[float, float]], count: int) -> Any:
    """Returns the tm_friction_def of (static, kinetic) pairs, one an instrument."""
    definition = lib.tm_friction_def_default()
    if len(coefficients) != count:
        raise ArgumentError("friction: %d pairs of coefficients for %d instruments; give one each" % (len(coefficients), count))
    for k, (static, kinetic) in enumerate(coefficients):
        definition.instrument[k].mu_static, definition.instrument[k].mu_kinetic = static, kinetic
    return definition


class FrictionStation(NamedTuple):
    """Friction at one station of an instrument's axis. Station 0 is the tip; stations are one radius apart."""

    station: int
    slips: bool  #: slid in the last step
    force_N: Floats  #: (3,) force on the tissue, N
    normal: Floats  #: (3,) unit, from tool to tissue
    normal_force_N: float  #: normal force, N; |force_N| <= coefficient * normal_force_N
    coefficient: float
    stick_state: float  #: 1 stuck: the static coefficient holds; 0 slid


class Friction(_Part):
    """Coulomb friction of the instruments of a Contact: (static, kinetic) of each; (0, 0) is frictionless."""

    def __init__(self, world: WorldState, contact: Contact, coefficients: Sequence[Tuple[float, float]]) -> None:
        super().__init__(world)
        definition = friction_definition(coefficients, contact.instrument_count)
        call(lib.tm_stage_friction, world, contact, ctypes.byref(definition), ctypes.byref(self._handle))

    def stations(self, instrument: int = 0) -> List[FrictionStation]:
        """Returns the stations that were in contact in the last step."""
        grip = (c.tm_friction_station * 64)()
        count = lib.tm_friction_stations(self, instrument, grip, len(grip))
        return [FrictionStation(g.station, g.slips, inside(g, "force_N", (3,)), inside(g, "normal", (3,)), g.normal_force_N, g.coefficient, g.stick_state)
                for g in grip[:min(count, len(grip))]]


class Grasp(_Part):
    """Grasping by instruments of mode "grasper": jaws close on the tissue above close_grip and open below open_grip.

    Options (tm_grasp_def): close_grip (0.7), open_grip (0.3), jaw_length_m, reach_m, compliance_m_N, release_time_s, force_cap_N, max_vertices.
    """

    def __init__(self, world: WorldState, contact: Contact, **options: Any) -> None:
        super().__init__(world)
        definition = lib.tm_grasp_def_default()
        fill(definition, options)
        call(lib.tm_stage_grasp, world, contact, ctypes.byref(definition), ctypes.byref(self._handle))

    def vertices(self, instrument: int = 0) -> Tuple[Ints, str]:
        """Returns ((n,) vertices in its jaws, "open" | "holding" | "releasing")."""
        vertex, state = ctypes.c_void_p(), ctypes.c_int()
        count = lib.tm_grasp_vertices(self, instrument, ctypes.byref(vertex), ctypes.byref(state))
        return view(self, vertex.value, (count,), "int32").copy(), HELD[state.value]


class Cut(_Part):
    """Cutting by active instruments of mode "cautery": removes the tetrahedra that they touch. The tissue must be cuttable.

    rate_1_s: largest number of tetrahedra per second that one cautery removes. loose: detached fragments "fall" or are "removed". fade_s: time within
    which the force from a removed tetrahedron falls to 0; 0: at once.
    """

    def __init__(self, world: WorldState, contact: Contact, rate_1_s: float = 200.0, loose: str = "fall", fade_s: float = 0.0) -> None:
        super().__init__(world)
        definition = lib.tm_cut_def_default()
        definition.rate_1_s = rate_1_s
        definition.fade_s = fade_s
        definition.loose = choice(loose, {"fall": c.TM_LOOSE_FALL, "removed": c.TM_LOOSE_REMOVE}, "loose")
        call(lib.tm_stage_cut, world, contact, ctypes.byref(definition))

    def fetch_removed(self) -> Tuple[Ints, Ints]:
        """Returns ((n,) tetrahedra removed since the last call, (n,) instrument of each, -1: a detached fragment), oldest first."""
        room = self.world.tissue.mesh.tet_count
        tet, who = np.empty(room, np.int32), np.empty(room, np.int8)
        count = lib.tm_cut_fetch_removed(self.world, address(tet), address(who), room)
        return tet[:count].copy(), who[:count].astype(np.int32)


def tip_force(trocar_m: Any, tip_m: Any, point_m: Any, force_N: Any) -> Floats:
    """Returns the equivalent tip force (3,) of a force (3,) at a point (3,) of a tool that pivots about its trocar."""
    out = np.zeros(3)
    given = [floats(v, (3,), n) for v, n in ((trocar_m, "trocar_m"), (tip_m, "tip_m"), (point_m, "point_m"), (force_N, "force_N"))]
    lib.tm_tip_force(*[address(g) for g in given], address(out))
    return out
