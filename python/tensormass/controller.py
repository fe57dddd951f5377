"""The controller's core for co-simulation: the pure tick of haptic-rt, and its extrapolators by themselves."""
from __future__ import annotations

import ctypes
from typing import Any, Dict, List, Optional

import numpy as np

from . import _bind as c
from ._core import ArgumentError, fields, lib
from .instruments import Reaction
from .patch import Patch

EXTRAPOLATORS = {n[len("HRT_"):].lower(): getattr(c, n) for n in (
    "HRT_HOLD", "HRT_TIME", "HRT_POSITION", "HRT_BROYDEN", "HRT_TANGENT", "HRT_LOCAL_MODEL", "HRT_PAPER_POSITION", "HRT_ADAPTIVE")}
_JOINTS = c.HRT_JOINTS


def _which(name: str) -> int:
    number = ctypes.c_int()
    if not lib.hrt_extrapolator_find(name.encode(), ctypes.byref(number)):
        raise ArgumentError(f"extrapolator {name!r} is not known; use one of {', '.join(EXTRAPOLATORS)}", c.TM_ERR_ARGUMENT)
    return number.value


def _device_types() -> Any:
    library = lib._open("tensormass_controller")
    count = ctypes.c_int32.in_dll(library, "hrt_device_type_count").value
    return (ctypes.POINTER(c.hrt_device_type) * count).in_dll(library, "hrt_device_types")


def devices() -> Dict[str, List[str]]:
    """Returns the names of the controller's devices, each with its joints' names."""
    return {t.contents.name.decode(): [t.contents.joint[j].name.decode() for j in range(t.contents.joints)] for t in _device_types()}


def parameters(device: str = "impulse_engine", **values: Any) -> c.hrt_params:
    """Returns the controller's parameters by their names in C (force_max_N, stale_us, coupling_N_m ...; docs/controller.md), others at the device's
    defaults. ArgumentError names a parameter that is out of range."""
    params = c.hrt_params()
    number = lib.hrt_device_type_find(device.encode())
    if number < 0:
        raise ArgumentError(f"device {device!r} is not known; use one of {', '.join(devices())}", c.TM_ERR_ARGUMENT)
    lib.hrt_params_of_device(ctypes.byref(params), _device_types()[number])
    names = fields(params)
    for name, value in values.items():
        if name not in names:
            raise ArgumentError(f"parameter {name!r} is not known; use one of {', '.join(names)}", c.TM_ERR_ARGUMENT)
        field = getattr(params, name)
        if isinstance(field, ctypes.Array):
            numbers = [float(x) for x in value]
            if len(numbers) > len(field):
                raise ArgumentError(f"parameter {name!r}: {len(numbers)} values; it has {len(field)} at most", c.TM_ERR_ARGUMENT)
            field[:len(numbers)] = numbers
        else:
            setattr(params, name, value)
    row = lib.hrt_params_check(ctypes.byref(params))
    if row >= 0:
        raise ArgumentError(f"parameter {_words(row)} is not finite, or out of its range; see docs/controller.md", c.TM_ERR_ARGUMENT)
    return params


def _words(row: int) -> str:
    library = lib._open("tensormass_controller")
    table = (c.hrt_param_words * (row + 1)).in_dll(library, "hrt_param_text")
    return str(table[row].name.decode())


def sample(reaction: Reaction, t_us: int, trocar_m: Any = (0.0, 0.0, 0.0), seq: int = 0, session: int = 1, tool_session: int = 1,
           unilateral: bool = True, params: Optional[c.hrt_params] = None) -> c.hrt_sample:
    """Returns a force sample (t_n, P_n, F_n, K) from a simulation's reaction. t_us: time of the tip position, on the controller's clock. Positions become
    relative to the trocar. ArgumentError: the controller would reject it."""
    s = c.hrt_sample()
    s.session, s.tool_session, s.t_us, s.seq, s.unilateral, s.stiffness_kind = session, tool_session, t_us, seq, unilateral, reaction.stiffness_kind
    s.tip_m[:] = [float(p - o) for p, o in zip(reaction.tip_m, trocar_m)]
    s.force_N[:] = [float(f) for f in reaction.force_N]
    s.stiffness_N_m[:] = [float(k) for k in np.ravel(reaction.stiffness_N_m)]
    _accept(lib.hrt_sample_check(ctypes.byref(s), ctypes.byref(params if params is not None else parameters())))
    return s


def _accept(reject: int) -> None:
    if reject != c.HRT_ACCEPT:
        raise ArgumentError(f"the controller rejects it: {lib.hrt_reject_text(reject).decode()}", c.TM_ERR_ARGUMENT)


def controller_patch(patch: Patch, trocar_m: Any, seq: int = 0) -> c.hrt_patch:
    """Returns a simulation's patch in the controller's form: floats, relative to the trocar, checked. A grasp is not copied."""
    p, n, t = patch._struct, patch.vertex_count, patch.triangle_count
    if p.grasps:
        raise ArgumentError("the patch holds tissue; send it over LCM, or leave the hold out", c.TM_ERR_ARGUMENT)
    made, origin = c.hrt_patch(), np.asarray(trocar_m, float)
    made.seq, made.topology_revision, made.vertex_count, made.triangle_count = seq, p.topology_revision, n, t
    made.vertex_m[:3 * n] = (patch.vertex_m - origin).ravel().tolist()
    made.rest_m[:3 * n] = (patch.rest_m - origin).ravel().tolist()
    made.face[:t] = p.face[:t]
    made.triangle[:3 * t] = p.triangle[:3 * t]
    size = 3 * n * (3 * n + 1) // 2
    made.compliance_m_N[:size] = p.compliance_m_N[:size]
    for name in ("contact_compliance_m_N", "force_cap_N", "radius_m", "contact_length_m", "drag_s_m", "radiation_N_s_m", "radiation_s", "friction_static",
                 "friction_kinetic"):
        setattr(made, name, getattr(p, name))
    scratch = (ctypes.c_float * c.HRT_PATCH_COMPLIANCE)()
    _accept(lib.hrt_patch_prepare(ctypes.byref(made), scratch))
    return made


class Extrapolator:
    """One extrapolator: forces between samples, at any tip position and time. `name`: "hold", "time", "position", "broyden", "tangent", "local_model",
    "adaptive" ..."""

    def __init__(self, name: str = "adaptive", params: Optional[c.hrt_params] = None) -> None:
        self.params = params if params is not None else parameters()
        self._struct, self._kept = c.hrt_extrapolation(), [None, None, None]  # type: Any, List[Any]
        lib.hrt_extrapolation_reset(ctypes.byref(self._struct), _which(name))

    def take(self, sample: c.hrt_sample, patch: Optional[c.hrt_patch] = None) -> None:
        """Adds a newer sample with its patch."""
        if patch is not None:
            sample.patch = ctypes.addressof(patch)
        self._kept = [patch, *self._kept[:2]]  # the extrapolator may still point to the previous one
        lib.hrt_extrapolation_sample(ctypes.byref(self._struct), ctypes.byref(self.params), ctypes.byref(sample))

    def force(self, t_us: int, tip_m: Any) -> Any:
        """Returns the force (3,) on the tool, N, for a tip (3,) relative to the trocar, m."""
        tip, out = (ctypes.c_float * 3)(*[float(x) for x in tip_m]), (ctypes.c_float * 3)()
        lib.hrt_extrapolation_force(ctypes.byref(self._struct), ctypes.byref(self.params), int(t_us), tip, out)
        return np.array(out, float)


class Controller:
    """The controller of one instrument, without clock, bus or thread: call tick() every 2 ms of your time.

    axis: direction of the shaft into the body at zero pitch and yaw. up: of the device. params: parameters(...). States, limits and faults:
    docs/controller.md.
    """

    def __init__(self, axis: Any = (0.0, 0.0, -1.0), up: Any = (0.0, 1.0, 0.0), extrapolator: str = "adaptive", params: Optional[c.hrt_params] = None,
                 session: int = 1) -> None:
        self.params = params if params is not None else parameters()
        self.extrapolator = _which(extrapolator)
        self._axes, self._struct, self._input, self._result = c.hrt_axes(), c.hrt_controller(), c.hrt_input(), c.hrt_result()
        three = ctypes.c_float * 3
        if not lib.hrt_axes_along(ctypes.byref(self._axes), self.params.device, three(*map(float, axis)), three(*map(float, up))):
            raise ArgumentError("axis and up are parallel, zero or not finite; give two directions", c.TM_ERR_ARGUMENT)
        lib.hrt_init(ctypes.byref(self._struct), ctypes.byref(self.params), ctypes.byref(self._axes), session)
        self._kept: List[Any] = [None, None, None]

    def _device(self) -> Any:
        return ctypes.cast(self.params.device, ctypes.POINTER(c.hrt_device_type)).contents

    def _counted(self, joints: Any) -> List[float]:
        """Returns the joint values of the device; the leading ones are required."""
        values, device = [float(x) for x in joints], self._device()
        if len(values) > device.joints:
            raise ArgumentError(f"joints: {len(values)} of them; a {device.name.decode()} has {device.joints}", c.TM_ERR_ARGUMENT)
        return values

    def tip(self, joints: Any) -> Any:
        """Returns the tip (3,) of the device's joints, relative to the trocar, m."""
        joint, out = (ctypes.c_float * _JOINTS)(*self._counted(joints)), (ctypes.c_float * 3)()
        lib.hrt_tip(ctypes.byref(self._axes), joint, out)
        return np.array(out, float)

    def joints(self, tip_m: Any) -> Any:
        """Returns the device's joints that place the tip (3,) there; joints without a motor are 0."""
        out = (ctypes.c_float * _JOINTS)()
        if not lib.hrt_inverse(ctypes.byref(self._axes), (ctypes.c_float * 3)(*map(float, tip_m)), out):
            raise ArgumentError("tip_m: no joints put the tip at the trocar itself; give another", c.TM_ERR_ARGUMENT)
        return np.array(out[:self._device().joints], float)

    def tick(self, t_us: int, joints: Any, newest: Optional[c.hrt_sample] = None, patch: Optional[c.hrt_patch] = None, *, enable: bool = True,
             passivity: bool = True, coupling: bool = False, pedal: bool = False, reset: bool = False, bus_ok: bool = True,
             device_fault: int = 0) -> c.hrt_result:
        """Runs one tick at t_us with the device's joints as the encoders measured them. newest: a sample received since the last tick, with its patch.

        The result (hrt_result, the same object each time): state, fault, limits, torque[3], force_N[3], tip_m[3], gain ...
        """
        i, values = self._input, self._counted(joints)
        i.encoder_us, i.device_session, i.device_fault, i.bus_ok = t_us, 1, device_fault, bus_ok
        for j, value in enumerate(values):
            i.count[j] = round(lib.hrt_count_of_joint(ctypes.byref(self.params), j, value))
        i.enable, i.passivity, i.coupling, i.pedal, i.reset, i.extrapolator = enable, passivity, coupling, pedal, reset, self.extrapolator
        if newest is not None:
            newest.patch = None if patch is None else ctypes.addressof(patch)
            self._kept = [patch, *self._kept[:2]]
        lib.hrt_tick(ctypes.byref(self._struct), int(t_us), ctypes.byref(i), None if newest is None else ctypes.byref(newest),
                     ctypes.byref(self._result))
        return self._result

    @property
    def state(self) -> str:
        """State: "boot", "self_test", "idle", "engaged", "stale" or "fault"."""
        return str(lib.hrt_state_name(self._struct.state).decode())

    @property
    def fault(self) -> str:
        """Cause of the fault and remedy; "" without a fault."""
        return str(lib.hrt_fault_text(self._struct.fault).decode()) if self._struct.fault else ""

    @property
    def counters(self) -> Dict[str, int]:
        """Returns the counts of ticks and samples so far."""
        return {n: getattr(self._struct.counters, n) for n in fields(c.hrt_counters)}
