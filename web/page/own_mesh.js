// A scene for a mesh by itself: the lowest tenth is held, a probe presses from above along the middle.

// name: of the mesh file. rest_m: [3n].
export function sceneFor(name, rest_m) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < rest_m.length; i++) {
    low[i % 3] = Math.min(low[i % 3], rest_m[i]);
    high[i % 3] = Math.max(high[i % 3], rest_m[i]);
  }
  const size = Math.hypot(...high.map((h, a) => h - low[a])), tall = high[2] - low[2], [x, y] = [0, 1].map((a) => (low[a] + high[a]) / 2);
  // The highest vertex near the middle axis: there the probe presses.
  let top = low[2];
  for (let i = 0; i < rest_m.length; i += 3) if (Math.hypot(rest_m[i] - x, rest_m[i + 1] - y) < 0.15 * size) top = Math.max(top, rest_m[i + 2]);
  const m = (...p) => `[${p.map((v) => `${Number(v.toPrecision(6))} m`).join(', ')}]`, margin = 1e-3 * size, above = Math.min(0.1, 0.08 * size), deep = Math.min(0.3 * tall, 0.1 * size);
  return `# Made for a mesh by itself: change materials, supports and the hand as your organ needs.
title: ${name.replace(/[^\w .-]/g, '_')}
tissue:
  mesh: ${name}
  materials: {"*": {young: 10 kPa, poisson: 0.4, density: 1000 kg/m3}}
damping: {rate: 40 /s}
contact:
supports:
  - {name: bottom, box: {min: ${m(...low.map((v) => v - margin))}, max: ${m(high[0] + margin, high[1] + margin, low[2] + 0.1 * tall)}}}
instruments:
  - {mode: probe, trocar: ${m(x, y, top + Math.max(0.1, size))}, radius: ${Math.min(0.0025, 0.02 * size).toPrecision(3)} m}
hand:
  - instrument: 0
    repeat: yes
    path:
      - {time: 0 s, tip: ${m(x, y, top + above)}}
      - {time: 1.5 s, tip: ${m(x, y, top - deep)}}
      - {time: 2.5 s, tip: ${m(x, y, top - deep)}}
      - {time: 4 s, tip: ${m(x, y, top + above)}}
haptics: {extrapolator: adaptive, compliance: iterations}
time: {frame_rate: 25 Hz, duration: 60 s}
`;
}

// Files by the paths that a scene names, such as ../meshes/liver.msh: what is dropped on a page has a name only. yaml: of the scene. content: {name: bytes}.
export function byPaths(yaml, content) {
  const all = { ...content };
  for (const [path] of yaml.matchAll(/[^\s"'{}[\],]+/g)) {
    const name = path.split('/').pop();
    if (content[name]) all[path] = content[name];
  }
  return all;
}
