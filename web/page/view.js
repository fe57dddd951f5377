// The view: camera and pointer on this thread, the picture in the painter's worker (painter.js).
import { PerspectiveCamera, Plane, Raycaster, Vector2, Vector3 } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { placed } from './placed.js';

export class View {
  // failed(message): the picture cannot be drawn. frames, pictures and counts of marks: until the newest picture. first_ms: the organ's first picture;
  // moving_ms: the first of a frame of the tissue.
  constructor(canvas, failed) {
    this.canvas = canvas;
    Object.assign(this, { frames: 0, pictures: 0, counts: {} });
    this.painter = globalThis.boot.painter;
    this.answers = {
      drawn: ({ kind, organ, ...newest }) => {
        Object.assign(this, newest);
        if (organ && !this.first_ms) this.appeared();
        if (newest.frames) this.moving_ms ??= performance.now();
      },
      picture: ({ blob }) => this.saved(blob),
      failed: ({ message }) => failed(message),
    };
    this.painter.onmessage = ({ data }) => this.answers[data.kind](data);
    this.camera = new PerspectiveCamera(35, 1, 0.001, 10);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = !matchMedia('(prefers-reduced-motion: reduce)').matches;
    this.controls.addEventListener('change', () => this.look());
    this.dark = matchMedia('(prefers-color-scheme: dark)');
    this.dark.addEventListener('change', () => this.paint());
  }

  // The picture appears, or will never.
  appeared() {
    this.first_ms = performance.now();
    globalThis.boot.law.start();
  }

  // boot.js has given the canvas to the painter.
  start() {
    if (!globalThis.boot.able) return this.answers.failed({ message: 'This browser cannot draw in a worker, or its WebAssembly has no vectors; use Chromium 91, Firefox 105, Safari 17 or newer.' });
    new ResizeObserver(() => this.fit()).observe(this.canvas);
    return this.fit();
  }

  paint() { this.painter.postMessage({ kind: 'colour', dark: this.dark.matches }); }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.painter.postMessage({ kind: 'size', size: { width, height, ratio: Math.min(devicePixelRatio, 2) } });
  }

  look() {
    const { position, quaternion, near, far } = this.camera;
    this.painter.postMessage({ kind: 'look', position: position.toArray(), quaternion: quaternion.toArray(), near, far });
  }

  // Looks at a new organ between these corners.
  open({ low_m, high_m }) {
    this.controls.target.copy(placed(this.camera, low_m, high_m));
    this.controls.update();
    this.look();
  }

  show(mark, on) { this.painter.postMessage({ kind: 'show', mark, on }); }
  // The picture as a PNG.
  picture() { return new Promise((saved) => { this.saved = saved; this.painter.postMessage({ kind: 'save' }); }); }

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
    this.camera.updateMatrixWorld();
    const e = this.camera.matrixWorld.elements;
    return [[e[0], e[1], e[2]], [e[4], e[5], e[6]], [-e[8], -e[9], -e[10]]];
  }
}
