// The view: camera and pointer on this thread, the picture in the painter's worker (painter.js).
import { PerspectiveCamera, Plane, Raycaster, Vector2, Vector3 } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

export class View {
  // failed(message): the picture cannot be drawn. frames and counts of marks: of the newest picture.
  constructor(canvas, failed) {
    this.canvas = canvas;
    this.frames = 0;
    this.counts = {};
    this.painter = new Worker(new URL('./painter.js', import.meta.url), { type: 'module' });
    this.painter.onmessage = ({ data }) => this.answers[data.kind](data);
    this.answers = {
      drawn: ({ frames, counts }) => { Object.assign(this, { frames, counts }); this.first_ms ??= frames ? performance.now() : undefined; },
      picture: ({ blob }) => this.saved(blob),
      failed: ({ message }) => failed(message),
    };
    this.camera = new PerspectiveCamera(35, 1, 0.001, 10);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = !matchMedia('(prefers-reduced-motion: reduce)').matches;
    this.controls.addEventListener('change', () => this.look());
    this.dark = matchMedia('(prefers-color-scheme: dark)');
    this.dark.addEventListener('change', () => this.paint());
  }

  // Hands the canvas to the painter. port: to the tissue's worker.
  start(port) {
    if (!this.canvas.transferControlToOffscreen) return this.answers.failed({ message: 'This browser cannot draw in a worker; use Chromium 69, Firefox 105, Safari 17 or newer.' });
    const canvas = this.canvas.transferControlToOffscreen();
    this.painter.postMessage({ kind: 'start', canvas, port }, [canvas, port]);
    this.paint();
    new ResizeObserver(() => this.fit()).observe(this.canvas);
    return this.fit();
  }

  paint() { this.painter.postMessage({ kind: 'colour', value: this.dark.matches ? 0x1b1e21 : 0xe9edf0 }); }

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
    const low = new Vector3(...low_m), high = new Vector3(...high_m), centre = low.clone().add(high).multiplyScalar(0.5), size = high.distanceTo(low);
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).add(new Vector3(-0.35, -1.35, 0.95).multiplyScalar(size * Math.max(1, 1.1 / this.camera.aspect))); // a narrow screen shows its width
    this.camera.near = size / 100;
    this.camera.far = 20 * size;
    this.camera.updateProjectionMatrix();
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
