// Memory of the page over time: node memory.mjs PUPPETEER CHROMIUM URL SECONDS -> JSON: every 5 s the bytes of each heap after a collection.
// A press goes on throughout; gravity changes every 10 s, the scene (liver-cut, block-press) every 50 s, all marks are shown.
import { launch } from './browser.mjs';

const [, , puppeteer, executablePath, url, seconds] = process.argv, EVERY_MS = 5000;
const app = await launch(puppeteer, executablePath), page = await app.newPage();
await page.setViewport({ width: 600, height: 400 });
await page.goto(`${url}?scene=block-press`);
await page.waitForFunction(() => globalThis.tensormass?.state.last && globalThis.tensormass.state.law, { timeout: 60000 });
await page.evaluate(() => ['supports', 'patch', 'rows'].forEach((kind) => document.getElementById(`show-${kind}`).click()));
const choose = (name, value) => page.evaluate((n, v) => { const f = document.getElementById(`choice-${n}`); f.value = v; f.dispatchEvent(new Event('change')); }, name, value);
const heap = async (session) => {
  await session.send('HeapProfiler.collectGarbage');
  return (await session.send('Runtime.getHeapUsage')).usedSize;
};
const own = await page.createCDPSession(), workers = Object.fromEntries(page.workers().map((w) => [/(\w+)(\.worker)?\.js/.exec(w.url())[1], w]));
// Counts the buffers of WebGL from now on, in the painter's worker.
await workers.painter.evaluate(() => {
  globalThis.buffers = 0;
  const { createBuffer, deleteBuffer } = WebGL2RenderingContext.prototype;
  WebGL2RenderingContext.prototype.createBuffer = function () { globalThis.buffers++; return createBuffer.call(this); };
  WebGL2RenderingContext.prototype.deleteBuffer = function (b) { if (b) globalThis.buffers--; return deleteBuffer.call(this, b); };
});
const samples = [], until = Date.now() + 1000 * Number(seconds);
for (let i = 1; Date.now() < until; i++) {
  await new Promise((r) => setTimeout(r, EVERY_MS));
  if (i % 10 === 0) await choose('scene', i % 20 ? 'liver-cut' : 'block-press');
  else if (i % 2 === 0) await choose('gravity', i % 4 ? 'on' : 'off');
  samples.push({
    scene: await page.evaluate(() => tensormass.state.chosen.scene), page: await heap(own), tissue: await heap(workers.tissue.client), law: await heap(workers.law.client), painter: await heap(workers.painter.client),
    ...(await workers.painter.evaluate(() => ({ buffers, geometries: painter.renderer.info.memory.geometries }))),
    ...(await page.evaluate(() => ({
      wasm: tensormass.state.last.memory, lawWasm: tensormass.state.law.memory, used: tensormass.state.last.used, lawUsed: tensormass.state.law.used,
      frames: tensormass.view.frames,
    }))),
  });
}
await app.close();
console.log(JSON.stringify(samples));
