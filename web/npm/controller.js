// The controller's core: the pure tick of haptic-rt, at any rate, without clock, bus or thread (docs/controller.md).
import { TensormassError, constants } from './runtime.js';

export const extrapolators = ['hold', 'time', 'position', 'broyden', 'tangent', 'local_model', 'paper_position', 'adaptive'];
const PATCH_FIELDS = ['contact_compliance_m_N', 'force_cap_N', 'radius_m', 'contact_length_m', 'drag_s_m', 'radiation_N_s_m', 'radiation_s',
  'friction_static', 'friction_kinetic'];

// The controller of one instrument: call tick() every 2 ms of your time.
export class Controller {
  // axis: direction of the shaft into the body at zero pitch and yaw; up: of the device; trocar_m: origin of positions.
  // values: parameters by their names in C, {force_max_N: 3}; others are the device's defaults. Throws for one that is out of range.
  constructor(library, { axis = [0, 0, -1], up = [0, 1, 0], trocar_m = [0, 0, 0], extrapolator = 'adaptive', values = {}, session = 1n } = {}) {
    this.library = library;
    this.trocar_m = Array.from(trocar_m);
    this.params = library.make('hrt_params');
    library.call('hrt_params_default', this.params);
    for (const [name, value] of Object.entries(values)) {
      if (!(name in this.params)) throw new TensormassError(`parameter "${name}" is not known; use one of ${Object.keys(this.params.toObject()).join(', ')}`);
      this.params[name] = value;
    }
    if (library.call('hrt_params_check', this.params) >= 0) throw new TensormassError('a parameter is not finite, or out of its range; see docs/controller.md');
    this.axes = library.make('hrt_axes');
    if (!library.call('hrt_axes_along', this.axes, this.params.device, new Float32Array(axis), new Float32Array(up)))
      throw new TensormassError('axis and up are parallel, zero or not finite; give two directions');
    this.state_ = library.make('hrt_controller');
    this.input = library.make('hrt_input');
    this.result = library.make('hrt_result');
    this.sample_ = library.make('hrt_sample');
    // The controller may still point to the patches before the newest.
    this.patches = Array.from({ length: 3 }, () => library.make('hrt_patch'));
    this.newest = 0;
    this.scratch = library.allocate(4 * constants.HRT_PATCH_COMPLIANCE);
    this.number = library.allocate(4);
    this.seq = 0;
    this.select(extrapolator);
    library.call('hrt_init', this.state_, this.params, this.axes, session);
  }

  // Selects the extrapolator by name; the force blends over without a jump.
  select(name) {
    if (!this.library.call('hrt_extrapolator_find', name, this.number))
      throw new TensormassError(`extrapolator "${name}" is not known; use one of ${extrapolators.join(', ')}`);
    this.extrapolator = this.library.view(this.number, 1, 'i32')[0];
  }

  // Returns the device's joints for a tip position, m in the world; null at the trocar itself.
  joints(tip_m) {
    const out = this.library.allocate(28), tip = new Float32Array(tip_m.map((p, a) => p - this.trocar_m[a]));
    this.library.view(out, 7, 'f32').fill(0);
    const found = this.library.call('hrt_inverse', this.axes, tip, out) ? Array.from(this.library.view(out, 7, 'f32')) : null;
    this.library.free(out);
    return found;
  }

  // Takes a reaction of Scene.step, with the patch of Scene.patch, for the next tick. t_us: time of the tip position, on this controller's clock.
  // Returns "" or why the sample was rejected.
  sample(reaction, t_us, patch = null, unilateral = true) {
    const { library, sample_: s } = this;
    s.session = s.tool_session = 1n;
    s.t_us = Math.round(t_us);
    s.seq = ++this.seq;
    s.unilateral = unilateral;
    s.stiffness_kind = reaction.stiffness_kind;
    s.flags = reaction.flags & ~constants.HRT_FLAG_PATCH;
    s.tip_m = reaction.tip_m.map((p, a) => p - this.trocar_m[a]);
    s.force_N = reaction.force_N;
    s.stiffness_N_m = reaction.stiffness_N_m;
    s.patch = patch ? this.take(patch) : 0;
    const reject = library.call('hrt_sample_check', s, this.params);
    this.waiting = reject === constants.HRT_ACCEPT;
    return this.waiting ? '' : library.call('hrt_reject_text', reject);
  }

  // Copies a simulation's patch into the controller's form; returns its address, 0 if the controller would reject it or it contains a grasp.
  take(patch) {
    if (patch.grasps) return 0;
    const { library, trocar_m } = this;
    this.newest = (this.newest + 1) % this.patches.length;
    const made = this.patches[this.newest], n = patch.vertex_count, t = patch.triangle_count, size = (3 * n * (3 * n + 1)) / 2;
    library.bytes.fill(0, made.address, made.address + library.classOf('hrt_patch').size);
    made.seq = this.seq;
    made.topology_revision = patch.topology_revision;
    made.vertex_count = n;
    made.triangle_count = t;
    const relative = (positions) => positions.subarray(0, 3 * n).map((p, i) => p - trocar_m[i % 3]);
    made.vertex_m.set(relative(patch.vertex_m));
    made.rest_m.set(relative(patch.rest_m));
    made.face.set(patch.face.subarray(0, t));
    made.triangle.set(patch.triangle.subarray(0, 3 * t));
    made.compliance_m_N.set(patch.compliance_m_N.subarray(0, size));
    for (const name of PATCH_FIELDS) made[name] = patch[name];
    return library.call('hrt_patch_prepare', made, this.scratch) === constants.HRT_ACCEPT ? made.address : 0;
  }

  // Runs one tick at t_us with the tip there, m in the world. Returns the result's struct (state, fault, limits, force_N, gain ...), the same each time.
  tick(t_us, tip_m, { enable = true, passivity = true, coupling = false, reset = false, bus_ok = true } = {}) {
    const { library, input } = this, joints = this.joints(tip_m);
    input.encoder_us = Math.round(t_us);
    input.device_session = 1;
    input.bus_ok = bus_ok && joints !== null;
    if (joints) input.count = joints.map((value, j) => Math.round(library.call('hrt_count_of_joint', this.params, j, value)));
    Object.assign(input, { enable, passivity, coupling, reset, extrapolator: this.extrapolator });
    library.call('hrt_tick', this.state_, Math.round(t_us), input, this.waiting ? this.sample_ : null, this.result);
    this.waiting = false;
    return this.result;
  }

  // "boot", "self_test", "idle", "engaged", "stale" or "fault".
  get state() { return this.library.call('hrt_state_name', this.result.state); }
  // Cause of the fault and remedy; "" without a fault.
  get fault() { return this.result.fault ? this.library.call('hrt_fault_text', this.result.fault) : ''; }

  free() {
    for (const struct of [this.params, this.axes, this.state_, this.input, this.result, this.sample_, ...this.patches]) struct.free();
    this.library.free(this.scratch);
    this.library.free(this.number);
  }
}
