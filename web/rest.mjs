// Writes the organ at rest, the page's first picture: node rest.mjs NPM SCENES MESHES SCENE.MESH.rest.json. Micrometres; vertices of the surface only.
import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const [, , npm, scenes, meshes, to] = process.argv, [name] = path.basename(to).split('.');
// As a module: no package.json says that page/*.js are some.
const { filesOf, meshesOf, restOf, setsOf } = await import(`data:text/javascript,${encodeURIComponent(fs.readFileSync(new URL('page/scenes.js', import.meta.url), 'utf8'))}`);
const files = meshesOf(name).map((mesh) => filesOf(name, mesh)).find((of) => restOf(name, of) === path.basename(to));
const { Scene, load } = await import(pathToFileURL(path.resolve(npm, 'index.js'))), library = await load();
const yaml = fs.readFileSync(path.join(scenes, `${name}.yaml`), 'utf8');
const scene = new Scene(library, yaml, { files: Object.fromEntries(files.map((file) => [file, fs.readFileSync(path.join(meshes, file))])), sets: { ...setsOf(name, files, { law: 'linear' }), ...(/^haptics:/m.test(yaml) ? { haptics: null } : {}), ...(/^rendering:/m.test(yaml) ? { rendering: null } : {}) } });
const { triangles } = scene.surface, used = [...new Set(triangles)], at = new Map(used.map((v, i) => [v, i])), rest = scene.rest_m;
const rest_um = used.flatMap((v) => [0, 1, 2].map((a) => Math.round(1e6 * rest[3 * v + a])));
const corner = (of, from) => [0, 1, 2].map((a) => rest.reduce((so, x, i) => (i % 3 === a ? of(so, x) : so), from));
const instruments = Array.from({ length: scene.instrumentCount }, (_, i) => scene.instrument(i)).map(({ trocar_m, radius_m, mode, pose: { tip_m } }) => ({ trocar_m, radius_m, mode, pose: { tip_m } }));
fs.writeFileSync(to, JSON.stringify({ rest_um, triangles: Array.from(triangles, (v) => at.get(v)), instruments, low_m: corner(Math.min, Infinity), high_m: corner(Math.max, -Infinity) }));
