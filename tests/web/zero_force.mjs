// How long a force outlives the law's worker: node zero_force.mjs PUPPETEER CHROMIUM URL HAPLY_URL TIMES -> JSON: ms from the worker's last sign of life until
// zero force is sent, by the clock of the worker that owns the connection: p50, p99, worst. A debugger stops the law's worker each time.
import os from 'node:os';

import { launch, takeDevice } from './browser.mjs';

const [, , puppeteer, executablePath, url, haply, times] = process.argv, WAIT = { timeout: 20000, polling: 20 }, found = [];
const app = await launch(puppeteer, executablePath), page = await app.newPage();
await page.setViewport({ width: 500, height: 300 });
await page.goto(`${url}?scene=block-press`, { waitUntil: 'load' });
await page.waitForFunction(() => globalThis.tensormass?.state.last && tensormass.state.law, WAIT);
await takeDevice(page, haply);
const { client } = page.workers().find((w) => /law.worker/.test(w.url()));
for (let i = 0; i < 2 * Number(times) && found.length < Number(times); i++) {
  await page.waitForFunction(() => { // a fault that a stop has caused is reset
    if (tensormass.state.law.state === 'fault') document.getElementById('reset').click();
    return tensormass.state.force?.sent_N > 0.1;
  }, WAIT).catch(async (error) => {
    console.error(i, await page.evaluate(() => JSON.stringify([document.getElementById('device').textContent, tensormass.state.law.state, tensormass.state.law.fault, tensormass.state.law.vector])));
    throw error;
  });
  const trips = await page.evaluate(() => tensormass.state.force.trips);
  await client.send('Debugger.enable');
  await new Promise((paused) => { client.once('Debugger.paused', paused); client.send('Debugger.pause'); });
  // None if a pause of the browser had just taken the force back.
  const after = await page.waitForFunction((before) => tensormass.state.force.trips > before && tensormass.state.force.withheld_ms, { timeout: 1000, polling: 20 }, trips).catch(() => null);
  if (after) found.push(await after.jsonValue());
  await client.send('Debugger.resume');
  await client.send('Debugger.disable');
}
await app.close();
found.sort((a, b) => a - b);
const at = (p) => Number(found[Math.min(found.length - 1, Math.floor(p * found.length))].toFixed(1));
console.log(JSON.stringify({ times: found.length, p50_ms: at(0.5), p99_ms: at(0.99), worst_ms: at(1), load: os.loadavg()[0] }));
