// How fast the page is: node rate.mjs PUPPETEER CHROMIUM URL SECONDS -> JSON: time from the start of loading to the first picture of the organ (at rest) and to
// the first of a simulated frame, frames of the tissue shown a second (one that looks like the last is not drawn again), pictures drawn a second and their resolution, real-time factor, a frame's median, the lateness of the law's ticks (p99), processor
// time a second, load of the machine. The browser has started when loading begins.
import os from 'node:os';

import { launch } from './browser.mjs';

const [, , puppeteer, executablePath, url, seconds] = process.argv;
const app = await launch(puppeteer, executablePath), page = await app.newPage();
const look = () => page.evaluate(() => {
  const { view, state: { last, law } } = tensormass;
  return { at_s: performance.now() / 1000, first_ms: view.first_ms, moving_ms: view.moving_ms, frames: view.frames, pictures: view.pictures, scale: view.scale, time_s: last.time_s, median_ms: last.median_ms, late_ms: law.late_ms };
});
await page.setViewport({ width: 1280, height: 800 });
await new Promise((r) => setTimeout(r, 2500));
await page.goto(url);
await page.waitForFunction(() => globalThis.tensormass?.view.moving_ms && tensormass.state.law, { timeout: 120000, polling: 100 });
const session = await app.target().createCDPSession();
const processor_ms = async () => (await session.send('SystemInfo.getProcessInfo')).processInfo.reduce((sum, p) => sum + 1000 * p.cpuTime, 0);
await new Promise((r) => setTimeout(r, 1000)); // the resolution settles
const from = await look(), before_ms = await processor_ms();
await new Promise((r) => setTimeout(r, 1000 * seconds));
const to = await look(), past_s = to.at_s - from.at_s, used_ms = (await processor_ms()) - before_ms;
await app.close();
console.log(JSON.stringify({
  first_picture_ms: to.first_ms, first_frame_ms: to.moving_ms, frames_shown_a_second: (to.frames - from.frames) / past_s, pictures_a_second: (to.pictures - from.pictures) / past_s, scale: to.scale, factor: (to.time_s - from.time_s) / past_s, median_ms: to.median_ms, late_p99_ms: to.late_ms, processor_ms_a_second: used_ms / past_s,
  load: os.loadavg()[0],
}));
