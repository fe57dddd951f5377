// tensormass: soft tissue for haptics and surgical simulation (docs/web.md).
export { Library, TensormassError, constants, hasSimd, load } from './runtime.js';
export { Scene } from './scene.js';
export { Tie, Ties, Touch } from './bodies.js';
export { Contact, Grasp, Material, Mesh, Tissue, World } from './objects.js';
export { Controller, extrapolators } from './controller.js';
export { readLog } from './log.js';
