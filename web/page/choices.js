// What the page lets one choose: each choice is a setting of the scene, with the price that was measured here and the error of the study in study.json.
import { SCENES, meshesOf } from './scenes.js';
import study from './study.json';

const nothing = () => ({});
// Hard cases that are settings of the scene. "jumps" and "still" are the tissue worker's, "late", "lost" and "forged" the law's.
const HARD = {
  incompressible: { 'tissue.materials.*.poisson': 0.4999 }, smoothed: { 'tissue.materials.*.poisson': 0.4999, strain_smoothing: '{}' },
  soft: { 'tissue.materials.*.young': '1 kPa' }, tremor: { 'hand[0].tremor': '{amplitude: 1 mm, frequency: 9 Hz}' },
};
const CHOICES = {
  scene: { text: 'Scene', values: Object.keys(SCENES), names: Object.values(SCENES).map((s) => s.text), sets: nothing },
  mesh: { text: 'Mesh', values: [], sets: nothing },
  law: {
    text: 'Law', values: ['linear', 'rotation', 'neo-hooke', 'mooney-rivlin', 'st-venant-kirchhoff', 'fung'],
    names: ['linear', 'linear, with rotation', 'neo-Hooke', 'Mooney-Rivlin', 'St. Venant-Kirchhoff', 'Fung'],
    sets: (v) => (v === 'linear' ? {} : v === 'rotation' ? { rotation: '{}' } : { 'tissue.materials.*.law': v, ...(v === 'fung' ? { 'tissue.materials.*.C': '5 kPa' } : {}) }),
  },
  smoothing: { text: 'Strain smoothing', values: ['off', 'on'], sets: (v) => (v === 'on' ? { strain_smoothing: '{}' } : {}) },
  viscosity: { text: 'Viscosity', values: ['off', 'on'], sets: (v) => (v === 'on' ? { viscosity: '{terms: [{time: 0.3 s, shear: 0.4}]}' } : {}) },
  friction: { text: 'Friction', values: ['off', 'on'], sets: (v) => (v === 'on' ? { friction: '{static: 0.3, kinetic: 0.2}' } : {}) },
  gravity: { text: 'Gravity', values: ['off', 'on'], sets: (v) => (v === 'on' ? { gravity: '{}' } : {}) },
  step: { text: 'Step', values: ['0.9', '0.45', '1'], names: ['0.9 of the critical', 'half of that', 'the whole critical step'], sets: (v) => (v === '0.9' ? {} : { 'time.step_fraction': v }) },
  rate: { text: 'Samples', values: ['25 Hz', '50 Hz', '100 Hz'], sets: (v) => (v === '25 Hz' ? {} : { 'time.frame_rate': v }) },
  extrapolator: { text: 'Extrapolator', values: ['adaptive', 'local_model', 'tangent', 'position', 'time', 'hold'], sets: nothing },
  hard: {
    text: 'Hard case', values: ['none', 'incompressible', 'smoothed', 'soft', 'tremor', 'jumps', 'still', 'late', 'lost', 'forged'],
    names: ['none', "Poisson's ratio 0.4999", '0.4999, strain smoothing', 'ten times as soft', 'the hand trembles by 1 mm', 'the tool jumps', 'the tool stands still', 'samples 100 ms late',
      'every second sample lost', 'every third sample forged'],
    sets: (v) => (v === 'none' ? {} : { energy: '{}', ...HARD[v] }), // with the account of energy, as the verdict
  },
};

function select(name, { text, values, names = values }, state, changed) {
  const label = document.createElement('label'), field = document.createElement('select'), price = document.createElement('span'), error = document.createElement('span');
  label.textContent = text;
  label.htmlFor = field.id = `choice-${name}`;
  price.className = 'price';
  price.id = `price-${name}`;
  error.className = 'error';
  error.id = `error-${name}`;
  fill(field, values, names);
  state.chosen[name] = field.value;
  field.onchange = () => {
    state.chosen[name] = field.value;
    if (name === 'scene') offer(state);
    tell(state);
    state.changed = { name, before_ms: state.last?.median_ms, at: performance.now() };
    changed(name);
  };
  return [label, field, error, price];
}

function fill(field, values, names) {
  field.replaceChildren(...values.map((value, i) => new Option(names[i], value)));
}

const percent = (x) => `${x < 1 ? (100 * x).toPrecision(x < 0.1 ? 1 : 2) : (100 * x).toFixed(0)} %`;

// Choices whose first value is the scene as it is.
const PLAIN = { law: 1, viscosity: 1, friction: 1, gravity: 1, step: 1 };

// The study's error of what is chosen: of the force against the limit of fine meshes, of the force at the hand between samples, or by how much the force
// changes. Scenes of your own have no study; "" if a choice has no error.
function errorOf(name, chosen, own) {
  if (own) return name === 'mesh' ? 'no study of your own scene' : '';
  const found = study.scenes[chosen.scene], finest = meshesOf(chosen.scene).at(-1), file = SCENES[chosen.scene].meshes[chosen.mesh];
  if (name === 'scene' || name === 'hard' || (chosen[name] === CHOICES[name].values[0] && name in PLAIN)) return '';
  if (!found) return name === 'mesh' ? 'no study of this scene' : '';
  if (name !== 'mesh' && chosen.mesh !== finest) return 'not in the study, which has the finest mesh';
  const of = (value, prefix) => (value === undefined ? 'not in the study' : `${prefix}${percent(value)}`);
  if (name === 'mesh') return of(found.error?.mesh[file], 'error ');
  if (name === 'extrapolator' || name === 'rate') return of(found.samples[chosen.rate]?.[chosen.extrapolator], 'error at the hand ');
  if (name === 'smoothing' && chosen.law === 'linear') return of(found.error?.smoothing[chosen.smoothing], 'error ');
  return of(found.change[name]?.[chosen[name]], 'changes by ');
}

function tell(state) {
  for (const name of Object.keys(CHOICES)) document.getElementById(`error-${name}`).textContent = errorOf(name, state.chosen, state.own);
  const uncertainty = state.own ? undefined : study.scenes[state.chosen.scene]?.uncertainty;
  document.getElementById('uncertainty').textContent = uncertainty === undefined ? 'an unknown amount' : percent(uncertainty);
}

function offer(state) {
  const list = meshesOf(state.chosen.scene), field = document.getElementById('choice-mesh');
  fill(field, list, list);
  field.value = list.at(-1);
  state.chosen.mesh = field.value;
}

export const choices = {
  show(form, state, changed) {
    form.replaceChildren(...Object.entries(CHOICES).flatMap(([name, choice]) => select(name, choice, state, changed)));
    offer(state);
    this.follow(new URLSearchParams(location.search), state);
    tell(state);
  },
  // Chooses what the address says: ?scene=block-press&law=fung
  follow(asked, state) {
    for (const name of Object.keys(CHOICES)) {
      const field = document.getElementById(`choice-${name}`);
      if (![...field.options].some((o) => o.value === asked.get(name))) continue;
      field.value = state.chosen[name] = asked.get(name);
      if (name === 'scene') offer(state);
    }
  },
  tell,
  sets(chosen) { return Object.assign({}, ...Object.entries(CHOICES).map(([name, { sets }]) => sets(chosen[name]))); },
  // Shows the cost of a frame before and after a change, two seconds later.
  price({ changed }, now_ms) {
    if (!changed?.before_ms || performance.now() - changed.at < 2000) return;
    document.getElementById(`price-${changed.name}`).textContent = `${changed.before_ms.toFixed(1)} → ${now_ms.toFixed(1)} ms`;
  },
  // Returns the scene's text with its settings, for tm-sim.
  written({ yaml, sets }) {
    const lines = Object.entries(sets).map(([key, value]) => (value === null ? `--unset ${key}` : `--set '${key}=${value}'`));
    return `# Run it with: tm-sim scene.yaml --lockstep ${lines.join(' ')}\n${yaml}`;
  },
};
