// Draws the picture in a worker of its own, by three.js: organ, instruments, marks. The page's thread stays free for the hand and for the watchdog of a device.
// Frames come from the tissue's worker directly; camera, size and colours from the page (view.js). The first picture is the organ at rest, from a file.
// A picture that would not differ is not drawn. The resolution follows the time of a picture (scale.js); when nothing moves, it is complete.
import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, CylinderGeometry, DirectionalLight, DynamicDrawUsage, Group, HemisphereLight, Mesh, MeshPhysicalMaterial,
  MeshStandardMaterial, PerspectiveCamera, Scene, SphereGeometry, Vector3, WebGLRenderer,
} from 'three';
import { Marks, Strands, store } from './marks.js';
import { placed } from './placed.js';
import { Scale } from './scale.js';

const TISSUE = 0x9c3b32;
const wet = (color) => new MeshPhysicalMaterial({ color, roughness: 0.42, clearcoat: 0.35, clearcoatRoughness: 0.4 });

// SAME_PX: motion that a picture does not show. REST_MS: without a change, for a picture in full resolution. PIXELS_MAX: of a picture.
const SAME_PX = 0.25, REST_MS = 250, PIXELS_MAX = 8e6;

class Painter {
  // answer(): tells the tissue's worker that a frame was drawn, or replaced by a newer one.
  constructor(canvas, answer) {
    this.answer = answer;
    // Without transparency and multisampling, which a processor that draws pays for with half of its time.
    const context = canvas.getContext('webgl2', { alpha: false, antialias: false });
    if (!context) throw new Error('it gave no context');
    this.renderer = new WebGLRenderer({ canvas, context });
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(35, 1, 0.001, 10);
    const key = new DirectionalLight(0xffffff, 2.2);
    key.position.set(-1, -2, 3);
    this.camera.add(key);
    this.scene.add(this.camera, new HemisphereLight(0xffffff, 0x886655, 1.1), new AmbientLight(0xffffff, 0.25));
    // Materials of the organ's own surface and of what cuts exposed.
    this.organ = new Mesh(new BufferGeometry(), [wet(TISSUE), wet(0xd98a76)]);
    this.organ.frustumCulled = false;
    this.scene.add(this.organ);
    this.marks = new Marks(this.scene);
    this.strands = new Strands(this.scene);
    this.instruments = [];
    this.frames = 0;
    this.pictures = 0;
    this.scale = new Scale();
    this.fence = null;
    this.dirty = true; // the picture needs drawing
    this.next = null; // the newest frame, until it is drawn
    this.late = false; // the tissue is
    this.changed_ms = -Infinity;
    this.sharp = false; // the last picture has the full resolution
    this.placed = false; // the page has set the camera
    this.size = { width: 1, height: 1, ratio: 1 };
  }

  // Shows a new organ between two corners: positions [3n], triangles as in frame() (a recorded session: none yet), instruments of the scene, supported
  // vertices [3m], ends of ties [6k], the body of each vertex and the colours of bodies (none: all are tissue).
  open({ rest, triangles, own, instruments, supports, ties = [], bodies, colours, low_m, high_m }) {
    if (this.next) this.answer();
    Object.assign(this, { next: null, tips: null });
    this.organ.geometry.dispose();
    this.organ.geometry = new BufferGeometry();
    this.organ.geometry.setAttribute('position', new BufferAttribute(rest, 3).setUsage(DynamicDrawUsage));
    this.tint(bodies, colours);
    if (triangles) this.surface(triangles, own);
    this.instruments.forEach((i) => this.remove(i));
    this.instruments = instruments.map((i) => this.instrument(i));
    instruments.forEach(({ pose }, i) => pose && this.place(i, pose.tip_m));
    this.centre = placed(this.placed ? new PerspectiveCamera() : this.camera, low_m, high_m);
    if (!this.placed) this.camera.lookAt(this.centre);
    this.marks.open(new Vector3(...low_m).distanceTo(new Vector3(...high_m)));
    this.marks.place('supports', supports);
    this.strands.place(ties, this.marks.size_m);
    this.change();
  }

  // Gives each vertex the colour of its body.
  tint(bodies, colours) {
    const [skin] = this.organ.material, tinted = Boolean(bodies);
    if (tinted) {
      const colour = new Color(), values = new Float32Array(3 * bodies.length);
      bodies.forEach((body, v) => colour.set(colours[body] ?? TISSUE).toArray(values, 3 * v));
      this.organ.geometry.setAttribute('color', new BufferAttribute(values, 3));
    }
    skin.color.set(tinted ? 0xffffff : TISSUE);
    skin.needsUpdate = skin.vertexColors !== tinted;
    skin.vertexColors = tinted;
  }

  // The organ's triangles [3m], those that cuts exposed last; own: number of the others.
  surface(triangles, own = Infinity) {
    const { geometry } = this.organ, first = Math.min(3 * own, triangles.length);
    store(geometry, 'index', triangles, 1);
    geometry.clearGroups();
    geometry.addGroup(0, first, 0);
    geometry.addGroup(first, Infinity, 1);
    geometry.computeVertexNormals();
  }

  change() { Object.assign(this, { dirty: true, changed_ms: performance.now() }); }

  instrument({ trocar_m, radius_m, mode }) {
    const steel = new MeshStandardMaterial({ color: mode === 2 ? 0xd8b04a : 0xb8c0c8, metalness: 0.55, roughness: 0.35 });
    const group = new Group(), shaft = new Mesh(new CylinderGeometry(radius_m, radius_m, 1, 24), steel), tip = new Mesh(new SphereGeometry(radius_m, 24, 16), steel);
    group.add(shaft, tip);
    this.scene.add(group);
    return { group, shaft, tip, trocar: new Vector3(...trocar_m) };
  }

  remove({ group, shaft, tip }) {
    this.scene.remove(group);
    for (const part of [shaft, tip]) { part.geometry.dispose(); part.material.dispose(); }
  }

  // Takes a frame: position [3n]; triangles and own as in open(), if they changed; tips of the instruments; ends of the ties that hold; whether the tissue is
  // late. It replaces one that was not drawn yet.
  frame(frame) {
    const { triangles, own } = frame.triangles || !this.next ? frame : this.next;
    if (this.next) this.answer();
    this.next = { ...frame, triangles, own };
  }

  // Shows the newest frame.
  take({ position, triangles, tips, own, ties = [], patch, rows, late = false }) {
    const { geometry } = this.organ;
    this.frames++;
    this.late = late;
    this.next = null;
    if (!triangles && ties.length === 6 * this.strands.count && !this.moved(position, tips) && !patch?.length && !rows?.length && !this.marked) return;
    this.marked = Boolean(patch?.length || rows?.length);
    this.tips = tips;
    if (position.length > geometry.attributes.position.array.length) this.enlarge(position);
    else geometry.attributes.position.array.set(position);
    geometry.attributes.position.needsUpdate = true;
    if (triangles) this.surface(triangles, own);
    else if (geometry.index) geometry.computeVertexNormals();
    tips.forEach((tip_m, i) => this.place(i, tip_m));
    this.strands.place(ties, this.marks.size_m);
    if (patch) this.marks.place('patch', patch);
    if (rows) this.marks.rows(rows);
    this.change();
  }

  // A recorded surface has more vertices after a cut.
  enlarge(position) {
    const { geometry } = this.organ, larger = new Float32Array(Math.ceil(1.5 * position.length));
    larger.set(position);
    geometry.dispose();
    geometry.deleteAttribute('normal');
    geometry.setAttribute('position', new BufferAttribute(larger, 3).setUsage(DynamicDrawUsage));
  }

  // Returns whether a picture would show the motion since the last one.
  moved(position, tips) {
    const before = this.organ.geometry.attributes.position.array, pixel_m = (2 * Math.tan(Math.PI * 17.5 / 180) * this.camera.position.distanceTo(this.centre)) / this.size.height;
    const least_m = (SAME_PX * pixel_m) / this.size.ratio, far = (a, b) => a.some((x, i) => !(Math.abs(x - b[i]) < least_m));
    return !this.tips || far(position, before) || tips.some((tip_m, i) => far(tip_m, this.tips[i] ?? []));
  }

  place(i, tip_m) {
    const one = this.instruments[i];
    if (!one) return;
    const tip = new Vector3(...tip_m), along = one.trocar.clone().sub(tip), length = along.length();
    one.tip.position.copy(tip);
    one.shaft.position.copy(tip).addScaledVector(along, 0.5);
    one.shaft.scale.set(1, length, 1);
    one.shaft.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), along.normalize());
  }

  look({ position, quaternion, near, far }) {
    this.placed = true;
    this.camera.position.fromArray(position);
    this.camera.quaternion.fromArray(quaternion);
    Object.assign(this.camera, { near, far });
    this.camera.updateProjectionMatrix();
    this.change();
  }

  // Draws if something changed and the last picture is finished: a slow machine draws fewer. Draws once more, in full resolution, when nothing has changed for a
  // while. Returns whether a frame was shown or a picture drawn.
  draw() {
    if (this.fence) return false;
    const taken = this.next;
    if (taken) this.take(taken);
    const now = performance.now(), rests = !this.dirty && !this.sharp && now - this.changed_ms > REST_MS;
    if (!this.dirty && !rests) return Boolean(taken);
    this.fit(rests ? Math.max(1, this.scale.value) : this.scale.value);
    Object.assign(this, { dirty: false, sharp: rests || this.scale.value >= 1, since_ms: now - (this.begun ?? -Infinity), begun: now });
    this.renderer.render(this.scene, this.camera);
    const gl = this.renderer.getContext();
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.pictures++;
    this.wait(rests);
    return true;
  }

  // Waits until the picture is finished; its time decides on the resolution of the next.
  wait(rests) {
    const gl = this.renderer.getContext();
    if (gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED && !gl.isContextLost()) return setTimeout(() => this.wait(rests), 2);
    gl.deleteSync(this.fence);
    this.fence = null;
    this.picture_ms = performance.now() - this.begun;
    if (!rests && this.pictures > 3 && !this.fixed) this.scale.drawn(this.picture_ms, this.since_ms, this.late);
    return undefined;
  }

  // scale: share of the screen's resolution.
  fit(scale) {
    const { width, height, ratio } = this.size, canvas = this.renderer.domElement, fine = Math.min(ratio * scale, Math.sqrt(PIXELS_MAX / (width * height)));
    if (canvas.width === Math.floor(width * fine) && canvas.height === Math.floor(height * fine)) return;
    this.renderer.setPixelRatio(fine);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  // The picture as a PNG.
  save() {
    this.renderer.render(this.scene, this.camera); // what was drawn before is gone after a frame
    return this.renderer.domElement.convertToBlob();
  }
}

let painter, tissue;

const messages = {
  // rest: address of the organ at rest.
  async start({ canvas, port, rest, size, dark }) {
    tissue = port;
    tissue.onmessage = ({ data }) => messages[data.kind](data);
    const organ = fetch(rest).then((answer) => answer.json()).catch(() => null);
    try {
      painter = globalThis.painter = new Painter(canvas, () => tissue.postMessage({ kind: 'drawn' }));
    } catch (error) {
      postMessage({ kind: 'failed', message: `The picture needs WebGL2 in a worker: ${error.message}` });
      return;
    }
    messages.size({ size });
    messages.colour({ dark });
    painter.camera.aspect = size.width / size.height;
    const found = await organ;
    if (found && !painter.centre) painter.open({ ...found, rest: Float32Array.from(found.rest_um, (x) => 1e-6 * x), triangles: Uint32Array.from(found.triangles), supports: new Float32Array(0) });
    requestAnimationFrame(drawn);
  },
  open(message) { painter?.open(message); },
  frame(message) { painter?.frame(message); },
  look(message) { painter?.look(message); },
  size({ size }) {
    if (!painter || !size.width || !size.height) return;
    painter.size = size;
    painter.change();
  },
  colour({ dark }) {
    if (!painter) return;
    painter.scene.background = new Color(dark ? 0x1b1e21 : 0xe9edf0);
    painter.change();
  },
  show({ mark, on }) {
    painter?.marks.show(mark, on);
    painter?.change();
  },
  async save() { postMessage({ kind: 'picture', blob: await painter.save() }); },
  // Keeps a resolution, for measurements; none: it follows the time of a picture again.
  fix({ at }) { if (painter) Object.assign(painter.scale, { at: at ?? painter.scale.at }) && (painter.fixed = at !== undefined); },
};
onmessage = ({ data }) => messages[data.kind](data);

function drawn() {
  requestAnimationFrame(drawn);
  const before = painter.frames;
  if (!painter.draw()) return;
  if (painter.frames > before) painter.answer();
  const { frames, pictures, picture_ms, renderer: { domElement }, size, centre } = painter;
  const counts = { ...Object.fromEntries(['supports', 'patch', 'rows'].map((mark) => [mark, painter.marks.count(mark)])), ties: painter.strands.count };
  postMessage({ kind: 'drawn', frames, pictures, organ: Boolean(centre), picture_ms, scale: domElement.width / (size.width * size.ratio), counts });
}
