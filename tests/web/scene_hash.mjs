// Runs a scene under node: node scene_hash.mjs NPM FORM SCENE.yaml SECONDS [PATH=VALUE]... -> JSON with the state's hash, and the force after the first second.
import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const [, , npm, form, file, seconds, ...sets] = process.argv;
const { load, Scene } = await import(pathToFileURL(path.join(npm, 'index.js')));
const folder = path.dirname(file), meshes = path.join(folder, '../../meshes');
const files = Object.fromEntries(fs.readdirSync(meshes).filter((n) => /\.(msh|csv)$/.test(n)).map((n) => [`../../meshes/${n}`, fs.readFileSync(path.join(meshes, n))]));
const library = await load({ form });
const given = Object.fromEntries(sets.map((s) => [s.split('=')[0], s.includes('=') ? s.slice(s.indexOf('=') + 1) : null]));
const scene = new Scene(library, fs.readFileSync(file, 'utf8'), { files, sets: given });
let force_1s = null;
scene.run(Number(seconds), ({ time_s }) => { if (!force_1s && time_s > 1 - 1e-6) force_1s = scene.instrumentCount ? scene.reaction(0).force_N : [0, 0, 0]; });
const snapshot = scene.save(), frames = scene.frames, hash = scene.hash;
scene.run(2 * scene.frame_s);
const later = scene.hash;
scene.restore(snapshot);
const restored = scene.hash;
scene.run(2 * scene.frame_s);
console.log(JSON.stringify({ hash, force_1s, frames, form: library.form, restored, again: scene.hash === later }));
scene.close();
