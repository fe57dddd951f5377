// The picture: organ, instruments and force, by three.js.
import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, CylinderGeometry, DirectionalLight, DynamicDrawUsage, Group, HemisphereLight, Mesh, MeshPhysicalMaterial,
  MeshStandardMaterial, PerspectiveCamera, Plane, Raycaster, Scene, SphereGeometry, Vector2, Vector3, WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { Marks, store } from './marks.js';

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(35, 1, 0.001, 10);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = !matchMedia('(prefers-reduced-motion: reduce)').matches;
    const key = new DirectionalLight(0xffffff, 2.2);
    key.position.set(-1, -2, 3);
    this.camera.add(key);
    this.scene.add(this.camera, new HemisphereLight(0xffffff, 0x886655, 1.1), new AmbientLight(0xffffff, 0.25));
    // Materials of the organ's own surface and of what cuts exposed.
    const wet = (color) => new MeshPhysicalMaterial({ color, roughness: 0.42, clearcoat: 0.35, clearcoatRoughness: 0.4 });
    this.organ = new Mesh(new BufferGeometry(), [wet(0x9c3b32), wet(0xd98a76)]);
    this.organ.frustumCulled = false;
    this.scene.add(this.organ);
    this.marks = new Marks(this.scene);
    this.instruments = [];
    this.frames = 0;
    this.fineness = 1; // share of the screen's resolution
    this.fence = null;
    this.dirty = true; // the picture needs drawing
    this.controls.addEventListener('change', () => { this.dirty = true; });
    this.dark = matchMedia('(prefers-color-scheme: dark)');
    this.dark.addEventListener('change', () => this.paint());
    this.paint();
  }

  paint() {
    this.dirty = true;
    this.scene.background = new Color(this.dark.matches ? 0x1b1e21 : 0xe9edf0);
  }

  // Shows a new organ: rest positions [3n], instruments of the scene.
  open(rest, instruments) {
    this.organ.geometry.dispose();
    this.organ.geometry = new BufferGeometry();
    this.organ.geometry.setAttribute('position', new BufferAttribute(rest, 3).setUsage(DynamicDrawUsage));
    this.instruments.forEach((i) => this.remove(i));
    this.instruments = instruments.map((i) => this.instrument(i));
    const low = new Vector3(Infinity, Infinity, Infinity), high = low.clone().negate(), p = new Vector3();
    for (let i = 0; i < rest.length; i += 3) { p.fromArray(rest, i); low.min(p); high.max(p); }
    this.marks.open(high.distanceTo(low));
    const centre = low.clone().add(high).multiplyScalar(0.5), size = high.distanceTo(low);
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).add(new Vector3(-0.35, -1.35, 0.95).multiplyScalar(size));
    this.camera.near = size / 100;
    this.camera.far = 20 * size;
    this.camera.updateProjectionMatrix();
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

  // position: [3n]. triangles: [3m] if they changed, those that cuts exposed last; own: number of the others.
  frame(position, triangles, poses, own = Infinity) {
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
    poses.forEach((pose, i) => this.place(i, pose.tip_m));
    this.frames++;
    this.dirty = true;
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

  // Returns the pointer's position in the plane through `tip` that faces the camera.
  pointAt(x, y, tip_m) {
    const box = this.canvas.getBoundingClientRect(), at = new Vector2((2 * (x - box.left)) / box.width - 1, 1 - (2 * (y - box.top)) / box.height);
    const ray = new Raycaster(), facing = new Vector3(), hit = new Vector3();
    ray.setFromCamera(at, this.camera);
    this.camera.getWorldDirection(facing);
    return ray.ray.intersectPlane(new Plane().setFromNormalAndCoplanarPoint(facing, new Vector3(...tip_m)), hit) ? hit.toArray() : null;
  }

  // Returns the picture's directions in the world: right, up, away.
  directions() {
    const e = this.camera.matrixWorld.elements;
    return [[e[0], e[1], e[2]], [e[4], e[5], e[6]], [-e[8], -e[9], -e[10]]];
  }

  draw() {
    const { clientWidth: w, clientHeight: h } = this.canvas;
    if (this.fence && !this.drawn()) return; // the last picture is not finished: a slow machine draws fewer
    const ratio = Math.min(devicePixelRatio, 2) * this.fineness;
    if (this.canvas.width !== Math.floor(w * ratio) || this.canvas.height !== Math.floor(h * ratio)) {
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(w, h, false);
      this.camera.aspect = w / h;
      this.camera.updateProjectionMatrix();
      this.dirty = true;
    }
    this.controls.update();
    if (!this.dirty) return;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
    const gl = this.renderer.getContext();
    this.begun = performance.now();
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  // Returns whether the last picture is finished. A slow one lowers the resolution of the next.
  drawn() {
    const gl = this.renderer.getContext();
    if (gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED) return false;
    gl.deleteSync(this.fence);
    this.fence = null;
    const ms = performance.now() - this.begun;
    if (ms > 80) this.fineness = Math.max(0.4, this.fineness * (ms > 250 ? 0.5 : 0.8));
    return true;
  }
}
