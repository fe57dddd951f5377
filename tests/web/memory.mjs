// Memory of the page over time: node memory.mjs PUPPETEER BROWSER URL SECONDS -> every 10 s a line: bytes of the tissue's module and of the page's heap.
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const [, , puppeteer, executablePath, url, seconds] = process.argv;
const { default: engine } = await import(pathToFileURL(path.join(puppeteer, 'lib/puppeteer/puppeteer-core.js')));
const app = await engine.launch({ executablePath, headless: true, args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--js-flags=--expose-gc'] });
const page = await app.newPage();
await page.setViewport({ width: 600, height: 400 });
await page.goto(`${url}?scene=block-press`);
await page.waitForFunction(() => globalThis.tensormass?.state.last, { timeout: 60000 });
for (let i = 0; i < Number(seconds) / 10; i++) {
  if (i % 6 === 5) await page.evaluate((law) => { const f = document.getElementById('choice-law'); f.value = law; f.dispatchEvent(new Event('change')); }, i % 12 === 5 ? 'fung' : 'linear');
  await new Promise((r) => setTimeout(r, 10000));
  console.log(await page.evaluate(() => { globalThis.gc?.(); return tensormass.state.last.memory + performance.memory.usedJSHeapSize; }));
}
await app.close();
