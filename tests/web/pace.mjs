// What the page says of a tissue that does not keep up: node pace.mjs PACE.js -> JSON of the last sentence of each case.
import { pathToFileURL } from 'node:url';

const { Pace } = await import(pathToFileURL(process.argv[2])), seen = {};
// Frames of 40 ms, shown each `each_ms` and computed in `ms`, for some seconds.
function run(pace, each_ms, ms, seconds, from = 0) {
  let said = '';
  for (let i = 0; i * each_ms < 1000 * seconds; i++) said = pace.frame({ at_ms: from + i * each_ms, time_s: 0.04 * i, ms, frame_s: 0.04 });
  return said;
}
seen.keeps = run(new Pace(), 40, 30, 5);
seen.starts = run(new Pace(), 80, 80, 1.5); // too early to say
seen.slow = run(new Pace(), 80, 80, 5);
seen.little = run(new Pace(), 48, 46, 5);
const pace = new Pace();
run(pace, 80, 80, 5);
pace.forget();
seen.forgot = run(pace, 80, 80, 1.5, 100000);
console.log(JSON.stringify(seen));
