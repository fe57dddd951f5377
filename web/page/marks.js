// Marks on request: supported vertices, vertices of the patch that the law feels between samples, and contact rows.
import {
  BufferAttribute, BufferGeometry, ConeGeometry, CylinderGeometry, DynamicDrawUsage, InstancedMesh, LineBasicMaterial, LineSegments, Matrix4, MeshBasicMaterial, MeshStandardMaterial, Points,
  PointsMaterial, Quaternion, Vector3,
} from 'three';

// Numbers of one row in a message: point on the surface, normal from the tool to the tissue, force on the tissue, N.
export const ROW = 7;
const ROWS = 256, UP = new Vector3(0, 1, 0);

// Stores an attribute, or the index, in the geometry's buffer; makes a larger one only if it does not fit, as three.js frees a buffer with its geometry only.
export function store(geometry, name, values, size) {
  const index = name === 'index', old = index ? geometry.index : geometry.attributes[name];
  if (old && old.array.length >= values.length && old.array.constructor === values.constructor) {
    old.array.set(values);
    old.array.fill(0, values.length); // triangles without area
    old.needsUpdate = true;
  } else {
    if (old) geometry.dispose();
    const array = new values.constructor(Math.ceil(values.length * (old ? 1.5 : 1)));
    array.set(values);
    const made = new BufferAttribute(array, size).setUsage(DynamicDrawUsage);
    if (index) geometry.setIndex(made);
    else geometry.setAttribute(name, made);
  }
  geometry.setDrawRange(0, index ? values.length : values.length / size);
}

export class Marks {
  constructor(scene) {
    const points = (color) => new Points(new BufferGeometry(), new PointsMaterial({ color, size: 5, sizeAttenuation: false, depthTest: false }));
    const arrow = (geometry) => new InstancedMesh(geometry, new MeshBasicMaterial({ color: 0x35c46a, depthTest: false }), ROWS);
    this.points = { supports: points(0x3d7fd9), patch: points(0xf2c14e), rows: points(0x35c46a) };
    this.normals = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: 0xffffff, depthTest: false }));
    // The arrow's shaft and head: their own axis is y, from 0 to 1.
    this.shafts = arrow(new CylinderGeometry(0.5, 0.5, 1, 10).translate(0, 0.5, 0));
    this.heads = arrow(new ConeGeometry(1, 1, 14).translate(0, -0.5, 0));
    this.shown = { supports: [this.points.supports], patch: [this.points.patch], rows: [this.points.rows, this.normals, this.shafts, this.heads] };
    for (const one of Object.values(this.shown).flat()) { one.visible = false; one.frustumCulled = false; one.renderOrder = 1; scene.add(one); }
    this.open(0.1);
  }

  // size_m: of the organ. The largest force so far has an arrow of a quarter of it.
  open(size_m) {
    this.size_m = size_m;
    this.largest_N = 0.2;
    this.rows(new Float32Array(0));
  }

  show(kind, on) { this.shown[kind].forEach((one) => { one.visible = on; }); }
  count(kind) { return this.points[kind].geometry.drawRange.count; }
  // Places points of a kind, [3n] m.
  place(kind, position) { store(this.points[kind].geometry, 'position', position, 3); }

  // Draws rows, [ROW * n]: the point, the normal, and an arrow for the force that ends there.
  rows(values) {
    const count = Math.min(ROWS, values.length / ROW), at = new Float32Array(3 * count), ends = new Float32Array(6 * count);
    for (let i = 0; i < count; i++) this.largest_N = Math.max(this.largest_N, values[ROW * i + 6]);
    for (let i = 0; i < count; i++) {
      const [x, y, z, a, b, c, force_N] = values.subarray(ROW * i, ROW * (i + 1)), short = 0.03 * this.size_m;
      at.set([x, y, z], 3 * i);
      ends.set([x, y, z, x - short * a, y - short * b, z - short * c], 6 * i);
      this.arrow(i, new Vector3(x, y, z), new Vector3(a, b, c), (0.25 * this.size_m * force_N) / this.largest_N);
    }
    this.place('rows', at);
    store(this.normals.geometry, 'position', ends, 3);
    for (const part of [this.shafts, this.heads]) { part.count = count; part.instanceMatrix.needsUpdate = true; }
  }

  arrow(i, end, along, length) {
    const turn = new Quaternion().setFromUnitVectors(UP, along), wide = length > 0 ? 0.006 * this.size_m : 0, head = Math.min(0.4 * length, 0.03 * this.size_m);
    this.heads.setMatrixAt(i, new Matrix4().compose(end, turn, new Vector3(wide, head, wide)));
    this.shafts.setMatrixAt(i, new Matrix4().compose(end.clone().addScaledVector(along, -length), turn, new Vector3(0.5 * wide, length - head, 0.5 * wide)));
  }
}

// Ties between bodies that hold, as strands.
export class Strands {
  constructor(scene) {
    this.scene = scene;
    this.shape = new CylinderGeometry(1, 1, 1, 8).translate(0, 0.5, 0); // its own axis is y, from 0 to 1
    this.material = new MeshStandardMaterial({ color: 0xecc896, roughness: 0.6 });
    this.mesh = null;
    this.count = 0;
  }

  // ends: [6n] m, both ends of each. size_m: of the organ.
  place(ends, size_m) {
    this.count = ends.length / 6;
    if (!this.mesh || this.count > this.mesh.instanceMatrix.count) this.reserve(Math.ceil(1.5 * this.count));
    const wide = 0.0025 * size_m, from = new Vector3(), along = new Vector3(), turn = new Quaternion(), scale = new Vector3(), matrix = new Matrix4();
    for (let i = 0; i < this.count; i++) {
      from.fromArray(ends, 6 * i);
      along.fromArray(ends, 6 * i + 3).sub(from);
      scale.set(wide, Math.max(along.length(), 1e-9), wide);
      this.mesh.setMatrixAt(i, matrix.compose(from, turn.setFromUnitVectors(UP, along.divideScalar(scale.y)), scale));
    }
    this.mesh.count = this.count;
    this.mesh.instanceMatrix.needsUpdate = true;
  }

  reserve(count) {
    if (this.mesh) { this.scene.remove(this.mesh); this.mesh.dispose(); }
    this.mesh = new InstancedMesh(this.shape, this.material, count);
    this.mesh.frustumCulled = false;
    this.scene.add(this.mesh);
  }
}
