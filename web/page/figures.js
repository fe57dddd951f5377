// Figures and the plot of the force.
import { choices } from './choices.js';
import { ROW } from './marks.js';
import { $, state, view } from './state.js';

// The pictures that were drawn a second ago.
let counted = { pictures: 0, at_ms: 0 };
function pictures() {
  const past_s = (performance.now() - counted.at_ms) / 1000;
  if (past_s < 1) return;
  $('pictures').textContent = `${((view.pictures - counted.pictures) / past_s).toFixed(0)}/s, ${(100 * view.scale).toFixed(0)} %`;
  counted = { pictures: view.pictures, at_ms: performance.now() };
}

let shown_ms = 0;
// ties: [those that hold, all]; null: the scene has none.
export function tied(ties) {
  $('ties-row').hidden = !ties;
  if (ties) $('ties').textContent = `${ties[0]} of ${ties[1]} hold`;
}

export function figures({ median_ms, factor, memory, stages, energy, rows, ties }) {
  if (!stages && performance.now() - shown_ms < 200) return; // read by people
  shown_ms = performance.now();
  const { substeps, dt_s, frame_s } = state.opened;
  $('factor').textContent = `${factor.toFixed(2)}`;
  $('frame').textContent = `${median_ms.toFixed(1)} ms of ${(1000 * frame_s).toFixed(0)} ms`;
  $('substep').textContent = `${((1000 * median_ms) / substeps).toFixed(0)} us for ${(1e6 * dt_s).toFixed(0)} us`;
  $('memory').textContent = `${(memory / 1048576).toFixed(0)} MB`;
  const forces = rows.filter((_, i) => i % ROW === ROW - 1);
  $('rows').textContent = `${forces.length}; ${forces.filter((f) => f > 0).length} bear ${forces.reduce((sum, f) => sum + f, 0).toFixed(2)} N`;
  tied(ties);
  $('energy-row').hidden = $('residual-row').hidden = !energy;
  if (energy) {
    $('energy').textContent = `${(1000 * energy.generated_J).toFixed(3)}, ${(1000 * energy.put_in_J).toFixed(2)} mJ`;
    $('residual').textContent = `${energy.residual_J.toExponential(0)} J`;
  }
  choices.price(state, median_ms);
  pictures();
  if (!stages) return;
  const longest = stages.filter((s) => s.ms > 0.005).sort((a, b) => b.ms - a.ms).slice(0, 8);
  $('stages').tBodies[0].replaceChildren(...longest.map(({ name, ms }) => {
    const row = document.createElement('tr'), head = document.createElement('th'), cell = document.createElement('td');
    head.scope = 'row';
    head.textContent = name;
    cell.textContent = `${ms.toFixed(2)} ms`;
    row.append(head, cell);
    return row;
  }));
}

export function plot({ now, force, sampled, late_ms, state: name, fault, reasons }) {
  $('late').textContent = `${late_ms.toFixed(1)} ms`;
  $('state').textContent = fault || name;
  $('reset').hidden = name !== 'fault';
  $('rejected-row').hidden = !Object.keys(reasons).length;
  $('rejected').textContent = Object.entries(reasons).map(([why, n]) => `${n}: ${why}`).join('; ');
  const last = force.length ? force[force.length - 1] : 0;
  $('force-now').textContent = `${last.toFixed(2)} N`;
  const canvas = $('force'), style = getComputedStyle(document.body), ratio = Math.min(devicePixelRatio, 2), w = canvas.clientWidth, h = canvas.clientHeight;
  if (canvas.width !== Math.floor(w * ratio)) { canvas.width = Math.floor(w * ratio); canvas.height = Math.floor(h * ratio); }
  const c = canvas.getContext('2d', { willReadFrequently: true }); // drawn by this processor: a busy graphics one would stop the page's thread
  let top = 0.5;
  for (const values of [force, sampled]) for (let i = 1; i < values.length; i += 2) top = Math.max(top, values[i]);
  const x = (t) => w - ((now - t) / 4e6) * w, y = (f) => h - 6 - (f / (1.15 * top)) * (h - 12);
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, w, h);
  c.fillStyle = style.getPropertyValue('--soft');
  c.font = '12px system-ui';
  c.fillText(`${top.toFixed(1)} N`, 4, y(top) + 4);
  c.strokeStyle = style.getPropertyValue('--accent');
  c.lineWidth = 1.5;
  c.beginPath();
  for (let i = 0; i < force.length; i += 2) c.lineTo(x(force[i]), y(force[i + 1]));
  c.stroke();
  c.fillStyle = style.getPropertyValue('--dot');
  for (let i = 0; i < sampled.length; i += 2) c.fillRect(x(sampled[i]) - 1.5, y(sampled[i + 1]) - 1.5, 3, 3);
}

