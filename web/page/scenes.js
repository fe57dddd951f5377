// The scenes that come with the page, and their meshes, the finest last: one file, or one for each of `bodies`.
const LIVERS = { '1,180 tetrahedra': 'liver_1k.msh', '10,198 tetrahedra': 'liver_10k.msh' }, BLOCKS = { '1,176 tetrahedra': 'block_1k.msh' };
export const SCENES = {
  'liver-press': { text: 'A liver pressed by a probe', meshes: LIVERS },
  'liver-cut': { text: 'A liver grasped, pulled and cut', meshes: { '10,198 tetrahedra': 'liver_10k.msh', '15,238 tetrahedra': 'liver_cut.msh' } },
  cholecystectomy: {
    text: 'A gallbladder drawn off its bed', meshes: { '11,198 tetrahedra': ['liver_10k.msh', 'gallbladder_1k.msh'] }, bodies: ['liver', 'gallbladder'], materials: ['liver.*', 'gallbladder.*'],
    // The liver hardly rotates: the rotation of the gallbladder alone costs two fifths (docs/web.md). Laws include rotation, and other effects need it in all bodies or none.
    sets: ({ law, viscosity, smoothing }) => (law !== 'linear' ? { rotation: null } : viscosity === 'on' || smoothing === 'on' ? {} : { rotation: null, 'bodies.gallbladder.effects': '{rotation: }' }),
  },
  'block-press': { text: 'A block pressed by a probe', meshes: BLOCKS },
};

export const meshesOf = (scene) => Object.keys(SCENES[scene].meshes);

// The mesh files of a scene, by the mesh's name; of the finest, if it has no such mesh.
export const filesOf = (scene, mesh) => [SCENES[scene].meshes[mesh] ?? Object.values(SCENES[scene].meshes).at(-1)].flat();

// Settings that choose these files, and those of the scene beside the page's choices.
export function setsOf(scene, files, chosen) {
  const { bodies, sets = () => ({}) } = SCENES[scene];
  const meshes = bodies ? Object.fromEntries(bodies.map((body, i) => [`bodies.${body}.mesh`, files[i]])) : { 'tissue.mesh': files[0] };
  return { ...meshes, ...sets(chosen) };
}

// The page's choices name the material "*"; a scene that names several gets the choice for each.
export const choicesOf = (scene, sets) => Object.fromEntries(Object.entries(sets).flatMap(([key, value]) =>
  (key.startsWith('tissue.materials.*.') ? SCENES[scene].materials ?? ['*'] : ['*']).map((material) => [key.replace('*', material), value])));

// The file of the organ at rest, by scene and its first mesh file (rest.mjs writes it).
export const restOf = (scene, files) => `${scene}.${files[0].replace(/\.msh$/, '')}.rest.json`;
