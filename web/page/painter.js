// Draws the picture in a worker of its own, by three.js: organ, instruments, marks. The page's thread stays free for the hand and for the watchdog of a device.
// Frames come from the tissue's worker directly; camera, size and colours from the page (view.js).
import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, CylinderGeometry, DirectionalLight, DynamicDrawUsage, Group, HemisphereLight, Mesh, MeshPhysicalMaterial,
  MeshStandardMaterial, PerspectiveCamera, Scene, SphereGeometry, Vector3, WebGLRenderer,
} from 'three';
import { Marks, store } from './marks.js';

const wet = (color) => new MeshPhysicalMaterial({ color, roughness: 0.42, clearcoat: 0.35, clearcoatRoughness: 0.4 });

class Painter {
  constructor(canvas) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(35, 1, 0.001, 10);
    const key = new DirectionalLight(0xffffff, 2.2);
    key.position.set(-1, -2, 3);
    this.camera.add(key);
    this.scene.add(this.camera, new HemisphereLight(0xffffff, 0x886655, 1.1), new AmbientLight(0xffffff, 0.25));
    // Materials of the organ's own surface and of what cuts exposed.
    this.organ = new Mesh(new BufferGeometry(), [wet(0x9c3b32), wet(0xd98a76)]);
    this.organ.frustumCulled = false;
    this.scene.add(this.organ);
    this.marks = new Marks(this.scene);
    this.instruments = [];
    this.frames = 0;
    this.fineness = 1; // share of the screen's resolution
    this.fence = null;
    this.dirty = true; // the picture needs drawing
    this.answer = false; // the tissue's worker waits for its frame to be drawn
    this.size = { width: 1, height: 1, ratio: 1 };
  }

  // Shows a new organ between two corners: rest positions [3n], instruments of the scene, supported vertices [3m].
  open({ rest, instruments, supports, low_m, high_m }) {
    this.organ.geometry.dispose();
    this.organ.geometry = new BufferGeometry();
    this.organ.geometry.setAttribute('position', new BufferAttribute(rest, 3).setUsage(DynamicDrawUsage));
    this.instruments.forEach((i) => this.remove(i));
    this.instruments = instruments.map((i) => this.instrument(i));
    this.marks.open(new Vector3(...low_m).distanceTo(new Vector3(...high_m)));
    this.marks.place('supports', supports);
    this.dirty = true;
  }

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

  // position: [3n]. triangles: [3m] if they changed, those that cuts exposed last; own: number of the others. tips: of the instruments.
  frame({ position, triangles, tips, own = Infinity, patch, rows }) {
    const geometry = this.organ.geometry;
    geometry.attributes.position.array.set(position);
    geometry.attributes.position.needsUpdate = true;
    if (triangles) {
      store(geometry, 'index', triangles, 1);
      geometry.clearGroups();
      geometry.addGroup(0, Math.min(3 * own, triangles.length), 0);
      geometry.addGroup(Math.min(3 * own, triangles.length), Infinity, 1);
    }
    if (geometry.index) geometry.computeVertexNormals();
    tips.forEach((tip_m, i) => this.place(i, tip_m));
    if (patch) this.marks.place('patch', patch);
    if (rows) this.marks.rows(rows);
    this.frames++;
    this.dirty = this.answer = true;
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
    this.camera.position.fromArray(position);
    this.camera.quaternion.fromArray(quaternion);
    Object.assign(this.camera, { near, far });
    this.camera.updateProjectionMatrix();
    this.dirty = true;
  }

  // Draws if something changed and the last picture is finished: a slow machine draws fewer.
  draw() {
    if (!this.dirty || (this.fence && !this.finished())) return false;
    this.dirty = false;
    this.fit();
    this.renderer.render(this.scene, this.camera);
    const gl = this.renderer.getContext();
    this.begun = performance.now();
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    return true;
  }

  fit() {
    const { width, height, ratio } = this.size, canvas = this.renderer.domElement, fine = ratio * this.fineness;
    if (canvas.width === Math.floor(width * fine) && canvas.height === Math.floor(height * fine)) return;
    this.renderer.setPixelRatio(fine);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  // Returns whether the last picture is finished. A slow one lowers the resolution of the next.
  finished() {
    const gl = this.renderer.getContext();
    if (gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED) return false;
    gl.deleteSync(this.fence);
    this.fence = null;
    const ms = performance.now() - this.begun;
    if (ms > 80) this.fineness = Math.max(0.4, this.fineness * (ms > 250 ? 0.5 : 0.8));
    return true;
  }

  // The picture as a PNG.
  save() {
    this.renderer.render(this.scene, this.camera); // what was drawn before is gone after a frame
    return this.renderer.domElement.convertToBlob();
  }
}

let painter, tissue;

const messages = {
  start({ canvas, port }) {
    tissue = port;
    tissue.onmessage = ({ data }) => messages[data.kind](data);
    try {
      painter = globalThis.painter = new Painter(canvas);
    } catch (error) {
      postMessage({ kind: 'failed', message: `The picture needs WebGL2 in a worker: ${error.message}` });
      return;
    }
    requestAnimationFrame(drawn);
  },
  open(message) { painter?.open(message); },
  frame(message) { painter?.frame(message); },
  look(message) { painter?.look(message); },
  size({ size }) { if (painter) Object.assign(painter, { size, dirty: true }); },
  colour({ value }) { if (painter) { painter.scene.background = new Color(value); painter.dirty = true; } },
  show({ mark, on }) { painter?.marks.show(mark, on); if (painter) painter.dirty = true; },
  async save() { postMessage({ kind: 'picture', blob: await painter.save() }); },
};
onmessage = ({ data }) => messages[data.kind](data);

function drawn() {
  requestAnimationFrame(drawn);
  if (!painter.draw()) return;
  if (painter.answer) tissue.postMessage({ kind: 'drawn' });
  painter.answer = false;
  postMessage({ kind: 'drawn', frames: painter.frames, counts: Object.fromEntries(['supports', 'patch', 'rows'].map((mark) => [mark, painter.marks.count(mark)])) });
}
