// How fast the page is: node rate.mjs PUPPETEER CHROMIUM URL SECONDS -> JSON: time to the first picture from the start of loading, pictures a second, real-time factor,
// a frame's median, the lateness of the law's ticks (p99), load of the machine.
import os from 'node:os';

import { launch } from './browser.mjs';

const [, , puppeteer, executablePath, url, seconds] = process.argv;
const app = await launch(puppeteer, executablePath), page = await app.newPage();
const look = () => page.evaluate(() => {
  const { view, state: { last, law } } = tensormass;
  return { at_s: performance.now() / 1000, first_ms: view.first_ms, pictures: view.frames, time_s: last.time_s, median_ms: last.median_ms, late_ms: law.late_ms };
});
await page.setViewport({ width: 1280, height: 800 });
await page.goto(url);
await page.waitForFunction(() => globalThis.tensormass?.view.first_ms && tensormass.state.law, { timeout: 120000, polling: 100 });
const from = await look();
await new Promise((r) => setTimeout(r, 1000 * seconds));
const to = await look(), past_s = to.at_s - from.at_s;
await app.close();
console.log(JSON.stringify({ first_picture_ms: to.first_ms, pictures_a_second: (to.pictures - from.pictures) / past_s, factor: (to.time_s - from.time_s) / past_s, median_ms: to.median_ms, late_p99_ms: to.late_ms, load: os.loadavg()[0] }));
