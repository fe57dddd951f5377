// What a picture costs at each resolution: node picture_cost.mjs PUPPETEER CHROMIUM URL -> a table: share of the screen's resolution, processor time of the
// browser's drawing process for a picture, time until it is finished. The scene must move: a picture that would not differ is not drawn.
import { launch } from './browser.mjs';

const [, , puppeteer, executablePath, url] = process.argv, wait = (ms) => new Promise((r) => setTimeout(r, ms));
const app = await launch(puppeteer, executablePath), page = await app.newPage(), session = await app.target().createCDPSession();
const drawing_ms = async () => (await session.send('SystemInfo.getProcessInfo')).processInfo.filter((p) => p.type === 'GPU').reduce((sum, p) => sum + 1000 * p.cpuTime, 0);
await page.setViewport({ width: 1280, height: 800 });
await page.goto(url);
await page.waitForFunction(() => globalThis.tensormass?.view.moving_ms, { timeout: 120000, polling: 100 });
// The camera moves, so that every picture differs.
await page.evaluate(() => { (function turn() { tensormass.view.controls.autoRotate = true; requestAnimationFrame(turn); })(); });
const painter = page.workers().find((w) => /painter/.test(w.url())), look = () => painter.evaluate(() => ({ pictures: painter.pictures, ms: painter.picture_ms, width: painter.renderer.domElement.width, height: painter.renderer.domElement.height }));
console.log('| resolution | pixels | processor time of a picture | until it is finished, median |\n|---|---|---|---|');
for (const [at, share] of ['35 %', '50 %', '70 %', '100 %', '200 %'].entries()) {
  await page.evaluate((n) => tensormass.view.painter.postMessage({ kind: 'fix', at: n }), at);
  await wait(700);
  const before = await drawing_ms(), from = await look(), times = [];
  for (let i = 0; i < 40; i++) {
    await wait(75);
    times.push((await look()).ms);
  }
  const used = (await drawing_ms()) - before, to = await look();
  times.sort((a, b) => a - b);
  console.log(`| ${share} | ${to.width} x ${to.height} | ${(used / (to.pictures - from.pictures)).toFixed(0)} ms | ${times[20].toFixed(0)} ms |`);
}
await app.close();
