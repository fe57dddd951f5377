// The resolution of pictures by the times of pictures: node scale.mjs SCALE.js -> JSON.
import { pathToFileURL } from 'node:url';

const { SCALES, Scale } = await import(pathToFileURL(process.argv[2])), seen = {};
const after = (count, ms, since_ms, late, scale = new Scale()) => {
  for (let i = 0; i < count; i++) scale.drawn(ms, since_ms, late);
  return scale;
};
seen.start = new Scale().value;
seen.slow = after(20, 60, 80, false).value;
seen.fast = after(200, 5, 40, false).value;
seen.steady = after(200, 25, 40, false).value; // neither
seen.late = after(20, 25, 60, true).value; // the tissue is late, and drawing takes a large share
seen.unguilty = after(20, 5, 300, true).value; // the tissue is late by itself
const again = after(3, 60, 80, false, after(16, 5, 40, false));
seen.back = again.value;
seen.patient = after(100, 5, 40, false, again).value; // what was too slow is not tried again at once
seen.scales = SCALES;
console.log(JSON.stringify(seen));
