// What the page lets one choose: each choice is a setting of the scene, with the price that was measured here.
const LIVERS = { '1,180 tetrahedra': 'liver_1k.msh', '10,198 tetrahedra': 'liver_10k.msh' }, BLOCKS = { '1,176 tetrahedra': 'block_1k.msh' };
export const SCENES = {
  'liver-press': { text: 'A liver pressed by a probe', meshes: LIVERS },
  'liver-cut': { text: 'A liver grasped, pulled and cut', meshes: { '15,238 tetrahedra': 'liver_cut.msh' } },
  'block-press': { text: 'A block pressed by a probe', meshes: BLOCKS },
};

const nothing = () => ({});
const CHOICES = {
  scene: { text: 'Scene', values: Object.keys(SCENES), names: Object.values(SCENES).map((s) => s.text), sets: nothing },
  mesh: { text: 'Mesh', values: [], sets: nothing },
  law: {
    text: 'Law', values: ['linear', 'rotation', 'neo-hooke', 'mooney-rivlin', 'st-venant-kirchhoff', 'fung'],
    names: ['linear', 'linear, with rotation', 'neo-Hooke', 'Mooney-Rivlin', 'St. Venant-Kirchhoff', 'Fung'],
    sets: (v) => (v === 'linear' ? {} : v === 'rotation' ? { rotation: '{}' } : { 'tissue.materials.*.law': v }),
  },
  smoothing: { text: 'Strain smoothing', values: ['off', 'on'], sets: (v) => (v === 'on' ? { strain_smoothing: '{}' } : {}) },
  viscosity: { text: 'Viscosity', values: ['off', 'on'], sets: (v) => (v === 'on' ? { viscosity: '{terms: [{time: 0.3 s, shear: 0.4}]}' } : {}) },
  friction: { text: 'Friction', values: ['off', 'on'], sets: (v) => (v === 'on' ? { friction: '{static: 0.3, kinetic: 0.2}' } : {}) },
  gravity: { text: 'Gravity', values: ['off', 'on'], sets: (v) => (v === 'on' ? { gravity: '[0, 0, -9.81]' } : {}) },
  step: { text: 'Step', values: ['0.9', '0.6', '0.3'], names: ['0.9 of the critical', '0.6', '0.3'], sets: (v) => (v === '0.9' ? {} : { 'time.step_fraction': v }) },
  rate: { text: 'Samples', values: ['25 Hz', '50 Hz', '100 Hz'], sets: (v) => (v === '25 Hz' ? {} : { 'time.frame_rate': v }) },
  extrapolator: { text: 'Extrapolator', values: ['adaptive', 'local_model', 'tangent', 'position', 'time', 'hold'], sets: nothing },
};

const meshesOf = (scene) => Object.keys(SCENES[scene].meshes);

function select(name, { text, values, names = values }, state, changed) {
  const label = document.createElement('label'), field = document.createElement('select'), price = document.createElement('span');
  label.textContent = text;
  label.htmlFor = field.id = `choice-${name}`;
  price.className = 'price';
  price.id = `price-${name}`;
  fill(field, values, names);
  state.chosen[name] = field.value;
  field.onchange = () => {
    state.chosen[name] = field.value;
    if (name === 'scene') offer(state);
    state.changed = { name, before_ms: state.last?.median_ms, at: performance.now() };
    changed(name);
  };
  return [label, field, price];
}

function fill(field, values, names) {
  field.replaceChildren(...values.map((value, i) => new Option(names[i], value)));
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
  },
  sets(chosen) { return Object.assign({}, ...Object.entries(CHOICES).map(([name, { sets }]) => sets(chosen[name]))); },
  // Two seconds after a change: what a frame cost before and costs now.
  price({ changed }, now_ms) {
    if (!changed?.before_ms || performance.now() - changed.at < 2000) return;
    document.getElementById(`price-${changed.name}`).textContent = `${changed.before_ms.toFixed(1)} → ${now_ms.toFixed(1)} ms`;
  },
  // The scene with its settings, as tm-sim reads it.
  written({ yaml, sets }) {
    const lines = Object.entries(sets).map(([key, value]) => (value === null ? `--unset ${key}` : `--set '${key}=${value}'`));
    return `# Run it with: tm-sim scene.yaml --lockstep ${lines.join(' ')}\n${yaml}`;
  },
};
