"""Scenes: the YAML files that tm-sim runs, advanced frame by frame."""
from __future__ import annotations

import ctypes
import os
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Union

import numpy as np

from . import _bind as c
from ._core import ERRORS, ArgumentError, Diagnostics, Error, Floats, Object, floats, lib, view
from .instruments import Instrument, MODES, Pose, Reaction, reaction_of, rows_of
from .mesh import Mesh
from .patch import Patch
from .tissue import Surface, Tissue, surface_of
from .world import World

_MODE_NAMES = {v: k for k, v in MODES.items()}


def _raise(told: List[str], status: int, sentence: str = "") -> None:
    if status != c.TM_OK:
        raise ERRORS.get(status, Error)("\n".join(told) or sentence, status)


class Body(NamedTuple):
    """A body of a scene: its vertices (in the numbers of the mesh files, one body's after the other's; Mesh.from_original) and tetrahedra."""

    name: str
    vertices: range
    tets: range
    rigid: bool = False


class Scene(Object):
    """A scene as tm-sim reads it (docs/scene-reference.md), without controllers. Instruments follow the scene's hands or the poses that you give.

    sets: values that replace the scene's, {"time.frame_rate": 50, "gravity": None} (None removes a key). An error in the file raises an Error with
    "file:line: what; what to do"; a probable mistake is a SceneWarning.

    Results are bit-identical to `tm-sim --lockstep` of a scene without haptics. The programs record and render. Vertices keep the numbers of the mesh
    file. For a mesh of large bandwidth tm-sim renumbers internally, which is faster; {"tissue.renumber": True} does so here, with the same bits and
    snapshots. Everything is then in the numbering of `mesh` (Mesh.to_original).
    """

    def __init__(self, path: Union[str, "os.PathLike[str]"], sets: Optional[Mapping[str, Any]] = None) -> None:
        lines = [os.fsencode(k if v is None else f"{k}={_yaml(v)}") for k, v in (sets or {}).items()]
        array = (ctypes.c_char_p * (len(lines) + 1))(*lines)
        pointer = ctypes.c_void_p()
        self._said = Diagnostics()
        definition = lib.tm_scene_def_default()
        definition.file, definition.set, definition.set_count = os.fsencode(path), ctypes.cast(array, ctypes.c_void_p), len(lines)
        definition.diagnostics = ctypes.addressof(self._said.list)
        status = lib.tm_scene_open(ctypes.byref(definition), ctypes.byref(pointer))
        _raise(self._said.take(), status)
        self._own(pointer, lib.tm_scene_close, keep=self._said)
        self._about = lib.tm_scene_get_info(self)
        self.mesh: Mesh = Mesh._borrow(lib.tm_scene_mesh(self), self)
        self.tissue: Tissue = Tissue._borrow(lib.tm_scene_tissue(self), self.mesh, self)
        world = lib.tm_scene_world(self)
        #: None in the precomputed model; you may add stages to it
        self.world: Optional[World] = World._borrow(world, self.tissue, self) if world else None

    @property
    def title(self) -> str:
        """Title of the scene."""
        return str(self._about.title.decode())

    @property
    def model(self) -> str:
        """"dynamic", "precomputed" or "hybrid"."""
        return str(self._about.model.decode())

    @property
    def instruments(self) -> List[Instrument]:
        """The instruments at their first poses."""
        found = [lib.tm_scene_instrument(self, i) for i in range(self._about.instrument_count)]
        return [Instrument(tuple(d.trocar_m), tuple(d.pose.tip_m), _MODE_NAMES[d.mode], d.radius_m, d.contact_length_m, d.pose.roll_rad,
                           d.pose.grip, d.pose.active) for d in found]

    @property
    def bodies(self) -> Dict[str, Body]:
        """The scene's bodies by name; empty for a scene with tissue.mesh."""
        count = lib.tm_scene_get_bodies(self, None, 0)
        found = (c.tm_scene_body * max(1, count))()
        lib.tm_scene_get_bodies(self, found, count)
        return {b.name.decode(): Body(b.name.decode(), range(b.vertex_begin, b.vertex_end), range(b.tet_begin, b.tet_end), bool(b.rigid)) for b in found[:count]}

    frame_s: float = property(lambda self: self._about.frame_s, doc="Of a frame, s.")  # type: ignore[assignment]
    dt_s: float = property(lambda self: self._about.dt_s, doc="Of a substep, s.")  # type: ignore[assignment]
    substeps: int = property(lambda self: self._about.substeps, doc="Of a frame.")  # type: ignore[assignment]
    duration_s: float = property(lambda self: self._about.duration_s, doc="That the scene asks for, s.")  # type: ignore[assignment]

    @property
    def time_s(self) -> float:
        """Simulated time, s."""
        return float(lib.tm_scene_get_info(self).time_s)

    @property
    def frames(self) -> int:
        """Number of completed frames."""
        return int(lib.tm_scene_get_info(self).frames)

    @property
    def alive_count(self) -> int:
        """Number of active tetrahedra."""
        return int(lib.tm_scene_get_info(self).alive_count)

    def step(self, poses: Optional[Sequence[Pose]] = None) -> List[Reaction]:
        """Advances one frame: moves every instrument to its pose, or along the scene's hand (None). Returns the reactions, one an instrument."""
        to = None
        if poses is not None:
            if len(poses) != self._about.instrument_count:
                raise ArgumentError(f"{len(poses)} poses for {self._about.instrument_count} instruments; give one each", c.TM_ERR_ARGUMENT)
            to = (c.tm_tool_pose * max(1, len(poses)))(*[p._c() for p in poses])
        status = lib.tm_scene_step(self, to)
        told = self._said.take()  # also if a stage of the caller raised: the next call's diagnostics are its own
        if self.world is not None:
            self.world._raise_failed()
        _raise(told, status, f"frame {self.frames + 1}: a displacement or a force stopped being finite; the frame has not happened")
        return [self.reaction(i) for i in range(self._about.instrument_count)]

    def run(self, seconds: Optional[float] = None, each: Optional[Callable[["Scene"], Any]] = None) -> "Scene":
        """Runs complete frames for this long (None: the scene's duration). each(scene) is called after every frame; False stops."""
        total = int((self.duration_s if seconds is None else seconds) / self.frame_s + 0.5)
        for _ in range(total):
            self.step()
            if each is not None and each(self) is False:
                break
        return self

    def reaction(self, instrument: int = 0) -> Reaction:
        """Returns the instrument's reaction of the last frame."""
        self._check(instrument)
        return reaction_of(lib.tm_scene_reaction(self, instrument))

    def pose(self, instrument: int = 0) -> Pose:
        """Returns the instrument's pose at the end of the last frame."""
        self._check(instrument)
        return Pose._of(lib.tm_scene_pose(self, instrument))

    def pose_of_joints(self, instrument: int, joints: Any, active: bool = True) -> Pose:
        """Returns the pose in the world for joints of the instrument's device, in its order and units (Impulse Engine: pitch rad, yaw rad, insertion m,
        roll rad, grip 0 to 1). Missing joints are 0. ArgumentError: more joints than a device can have."""
        self._check(instrument)
        values = floats(joints, (-1,), "joints")
        if len(values) > c.HRT_JOINTS:
            raise ArgumentError(f"joints: {len(values)} of them; a device has {c.HRT_JOINTS} at most", c.TM_ERR_ARGUMENT)
        joint = (ctypes.c_double * c.HRT_JOINTS)(*values)
        return Pose._of(lib.tm_scene_pose_of(self, instrument, joint, active))

    def patch(self, instrument: int = 0) -> Optional[Patch]:
        """Returns a copy of the patch of the last frame. Returns None if the scene sends none (haptics: extrapolator) or no surface is near."""
        self._check(instrument)
        found = lib.tm_scene_patch(self, instrument)
        return Patch(c.tm_patch.from_buffer_copy(ctypes.string_at(found, ctypes.sizeof(c.tm_patch)))) if found else None

    @property
    def rows(self) -> Any:
        """Contact rows (n,) of the last substep, as Contact.rows; none in the precomputed model."""
        contact = lib.tm_scene_contact(self)
        return rows_of(self, lib.tm_contact_rows, contact) if contact else np.zeros(0, np.dtype(c.tm_contact_row))

    def _check(self, instrument: int) -> None:
        if not 0 <= instrument < self._about.instrument_count:
            raise IndexError(f"instrument {instrument} of {self._about.instrument_count}")

    @property
    def u_m(self) -> Floats:
        """(V, 3) displacements, m; get it again after a frame."""
        return view(self, lib.tm_scene_displacement(self), (self._about.vertex_count, 3))

    @property
    def position_m(self) -> Floats:
        """(V, 3) rest + displacement, m: a copy."""
        return self.mesh.rest_m + self.u_m

    @property
    def surface(self) -> Surface:
        """Surface that can be touched, in any model; get it again after a frame."""
        return surface_of(self, lib.tm_scene_surface(self))

    @property
    def hash(self) -> int:
        """Hash of the state's bits."""
        return int(lib.tm_scene_hash(self))

    def _raise(self, status: int) -> None:
        _raise(self._said.take(), status)

    def save(self, path: Union[str, "os.PathLike[str]"]) -> None:
        """Writes a snapshot, as tm-sim --snapshot does."""
        self._raise(lib.tm_scene_save(self, os.fsencode(path)))

    def restore(self, path: Union[str, "os.PathLike[str]"]) -> None:
        """Restores a snapshot of the same scene; a damaged one raises and changes nothing."""
        self._raise(lib.tm_scene_restore(self, os.fsencode(path)))


def _yaml(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_yaml(v) for v in value) + "]"
    return str(value)
