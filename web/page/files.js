// One's own files: meshes, scenes, recorded sessions; and what can be saved.
import { choices } from './choices.js';
import { byPaths } from './own_mesh.js';
import { $, fail, state, tissue, view } from './state.js';

async function take(list) {
  const content = {};
  let yaml = null, mesh = null, log = null;
  for (const file of list) {
    if (/\.ya?ml$/.test(file.name)) yaml = await file.text();
    else if (/(^log|\.log|\.lcm)$/.test(file.name)) log = new Uint8Array(await file.arrayBuffer());
    else content[file.name] = new Uint8Array(await file.arrayBuffer());
    if (/\.(msh|vtk|vtu|mesh)$/.test(file.name)) mesh = file.name;
  }
  if (log) return tissue.postMessage({ kind: 'play', bytes: log });
  if (!yaml && !mesh) return fail('No mesh, scene or log among these files; give a .msh, .vtk, .mesh, .yaml, .log or .lcm file.');
  const files = yaml ? byPaths(yaml, content) : content;
  state.own = yaml ? { yaml, files } : { mesh, files };
  if (yaml) {
    state.sent = { yaml, sets: {} };
    state.sentFiles = files;
    return tissue.postMessage({ kind: 'open', yaml, files, sets: {} });
  }
  return tissue.postMessage({ kind: 'mesh', name: mesh, files: content, sets: choices.sets(state.chosen) });
}

export function save(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

export function accept() {
  addEventListener('dragover', (e) => { e.preventDefault(); document.body.classList.add('dropping'); });
  addEventListener('dragleave', () => document.body.classList.remove('dropping'));
  addEventListener('drop', (e) => { e.preventDefault(); document.body.classList.remove('dropping'); take(e.dataTransfer.files); });
  $('file').onchange = (e) => take(e.target.files);
  $('save-yaml').onclick = () => save(new Blob([choices.written(state.sent)]), 'scene.yaml');
  $('save-snapshot').onclick = () => tissue.postMessage({ kind: 'snapshot' });
  $('save-picture').onclick = async () => save(await view.picture(), 'tissue.png');
}

