// Starts what takes time before the page's own code is there: the workers, the organ at rest, the library's compilation, the scene's files.
// Shares only vectors.js and scenes.js with the rest of the page, so that it is small.
import { hasSimd } from '../npm/vectors.js';
import { SCENES, filesOf, restOf } from './scenes.js';

// A worker whose messages wait until someone listens. It starts at once, or with start(): messages to it wait until then.
class Waiting {
  constructor(url, begin = true) {
    Object.assign(this, { url, sent: [], received: [], listener: (event) => this.received.push(event) });
    if (begin) this.start();
  }
  start() {
    if (this.worker) return;
    this.worker = new Worker(new URL(this.url, import.meta.url), { type: 'module' });
    this.worker.onmessage = (event) => this.listener(event);
    this.sent.splice(0).forEach(([message, ports]) => this.worker.postMessage(message, ports));
  }
  postMessage(message, ports = []) {
    if (this.worker) this.worker.postMessage(message, ports);
    else this.sent.push([message, ports]);
  }
  set onmessage(listener) {
    this.listener = listener;
    this.received.splice(0).forEach(listener);
  }
}

const painter = new Waiting('./painter.js'), tissue = new Waiting('./tissue.worker.js'), law = new Waiting('./law.worker.js', false);
const asked = new URLSearchParams(location.search), names = Object.keys(SCENES), scene = names.find((n) => n === asked.get('scene')) ?? names[0];
const meshes = filesOf(scene, asked.get('mesh'));
const canvas = document.getElementById('view'), pictures = new MessageChannel(), samples = new MessageChannel();
const start = (worker, message, ports) => worker.postMessage({ kind: 'start', ...message }, ports);
const fetched = async (path) => new Uint8Array(await (await fetch(`data/${path}`)).arrayBuffer());

const able = canvas.transferControlToOffscreen && hasSimd();
if (able) {
  const drawn = canvas.transferControlToOffscreen(), { clientWidth: width, clientHeight: height } = canvas;
  const dark = matchMedia('(prefers-color-scheme: dark)').matches;
  start(painter, { canvas: drawn, port: pictures.port2, rest: `data/${restOf(scene, meshes)}`, size: { width, height, ratio: Math.min(devicePixelRatio, 2) }, dark }, [drawn, pictures.port2]);
}
// Compiled once, for both workers; a server that sends .wasm by another type leaves it to them.
const form = 'simd', compiled = WebAssembly.compileStreaming(fetch('lib/simd.wasm')).catch(() => undefined);
compiled.then((module) => {
  start(tissue, { form, module, port: samples.port1, pictures: pictures.port1 }, [samples.port1, pictures.port1]);
  start(law, { form, module, port: samples.port2 }, [samples.port2]);
});
const files = new Map([`${scene}.yaml`, ...meshes].map((path) => [path, fetched(path)]));
files.forEach((file) => file.catch(() => undefined)); // the page's own code reports it

// able: the browser can run the page. fileOf(path): the bytes of a file of data/.
globalThis.boot = {
  able, painter, tissue, law,
  fileOf(path) {
    if (!files.has(path)) files.set(path, fetched(path));
    return files.get(path);
  },
};
