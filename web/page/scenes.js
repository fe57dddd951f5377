// The scenes that come with the page, and their meshes, the finest last.
const LIVERS = { '1,180 tetrahedra': 'liver_1k.msh', '10,198 tetrahedra': 'liver_10k.msh' }, BLOCKS = { '1,176 tetrahedra': 'block_1k.msh' };
export const SCENES = {
  'liver-press': { text: 'A liver pressed by a probe', meshes: LIVERS },
  'liver-cut': { text: 'A liver grasped, pulled and cut', meshes: { '10,198 tetrahedra': 'liver_10k.msh', '15,238 tetrahedra': 'liver_cut.msh' } },
  'block-press': { text: 'A block pressed by a probe', meshes: BLOCKS },
};

export const meshesOf = (scene) => Object.keys(SCENES[scene].meshes);

// The file of the organ at rest, by scene and mesh file (rest.mjs writes it).
export const restOf = (scene, mesh) => `${scene}.${mesh.replace(/\.msh$/, '')}.rest.json`;
