// What the parts of the page share: elements by id, the workers, the view, the state of choices and scene.
import { View } from './view.js';

export const $ = (id) => document.getElementById(id);
// boot.js has started them.
export const { tissue, law } = globalThis.boot;
export const view = new View($('view'), fail);
export const state = { chosen: {}, opened: null, held: -1, poses: [], price: {}, last: null, own: null, changed: null };

export function fail(message) {
  state.error = message;
  $('status').textContent = '';
  $('error').querySelector('pre').textContent = message;
  if (!$('error').open) $('error').showModal();
}
