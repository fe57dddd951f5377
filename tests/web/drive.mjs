// Drives the page in a browser: node drive.mjs PLAYWRIGHT BROWSER URL FOLDER -> JSON of what was seen; pictures in FOLDER.
import { writeFile } from 'node:fs/promises';
import { createRequire } from 'node:module';

const [, , playwright, browser, url, folder] = process.argv;
const { chromium, firefox } = createRequire(import.meta.url)(playwright);
const seen = { console: [] };
const engine = browser.includes('firefox') ? firefox : chromium;
const args = engine === chromium ? ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-background-networking',
  '--disable-component-update', '--disable-sync', '--no-first-run'] : [];
const app = await engine.launch({ executablePath: browser, args });

async function opened(options) {
  const context = await app.newContext(options), page = await context.newPage();
  page.on('console', (m) => { if (m.type() === 'error') seen.console.push(m.text()); });
  page.on('pageerror', (e) => seen.console.push(String(e)));
  const begun = Date.now();
  await page.goto(url);
  await page.waitForFunction(() => globalThis.tensormass?.state.last, null, { timeout: 90000 });
  return [page, Date.now() - begun];
}

// The protocol's own call: Playwright's waits for a still page.
async function picture(page, path) {
  if (engine === firefox) return page.screenshot({ path, timeout: 90000 });
  const protocol = await page.context().newCDPSession(page), { data } = await protocol.send('Page.captureScreenshot', { format: 'png' });
  return writeFile(path, Buffer.from(data, 'base64'));
}

// By the document: a mouse of Playwright's waits for pictures that a busy machine draws late.
const choose = (field, value) => page.evaluate(([f, v]) => {
  const element = document.querySelector(f);
  element.value = v;
  element.dispatchEvent(new Event('change'));
}, [field, value]);

const [page, first_ms] = await opened({ viewport: { width: 1280, height: 800 } });
seen.first_ms = first_ms;
await page.waitForTimeout(4000);
seen.frames = await page.evaluate(() => tensormass.view.frames);
seen.figures = await page.evaluate(() => Object.fromEntries([...document.querySelectorAll('#figures td')].map((c) => [c.id, c.textContent])));
seen.controller = await page.evaluate(() => tensormass.state.law?.state);
seen.stages = await page.evaluate(() => document.querySelectorAll('#stages tr').length);
await picture(page, `${folder}/desktop.png`);

// Taken by the keyboard, the tip moves and the tissue answers.
await page.evaluate(() => document.getElementById('take').click());
const before = await page.evaluate(() => tensormass.state.poses[0].tip_m);
await page.evaluate(() => document.getElementById('view').focus());
for (let i = 0; i < 10; i++) await page.keyboard.press('PageDown');
await page.waitForTimeout(500);
const after = await page.evaluate(() => tensormass.state.last.poses[0].tip_m);
seen.moved_m = Math.hypot(...after.map((x, a) => x - before[a]));
await page.evaluate(() => document.getElementById('take').click());

// A law that changes forces; the page shows the price.
await choose('#choice-law', 'neo-hooke');
await page.waitForFunction(() => /→/.test(document.getElementById('price-law').textContent), null, { timeout: 60000 });
seen.price = await page.textContent('#price-law');

// A mesh that is none: the library's own sentence.
await page.setInputFiles('#file', { name: 'bad.msh', mimeType: 'text/plain', buffer: Buffer.from('$MeshFormat\nnonsense\n') });
await page.waitForFunction(() => document.getElementById('error').open, null, { timeout: 60000 });
seen.error = await page.textContent('#error pre');
await page.evaluate(() => document.querySelector('#error button').click());

// Hidden, the force is zero.
await page.evaluate(() => { Object.defineProperty(document, 'hidden', { value: true, configurable: true }); document.dispatchEvent(new Event('visibilitychange')); });
await page.waitForTimeout(200);
seen.hidden = await page.evaluate(() => [tensormass.state.law.state, Math.hypot(...tensormass.state.law.vector[0])]);
await page.evaluate(() => { Object.defineProperty(document, 'hidden', { value: false, configurable: true }); document.dispatchEvent(new Event('visibilitychange')); });

// A scripted press in the worker, for comparison with the native build.
await choose('#choice-law', 'linear');
await choose('#choice-scene', 'block-press');
await page.waitForFunction(() => document.body.dataset.scene === 'block-press', null, { timeout: 60000 });
await choose('#choice-mesh', '1,176 tetrahedra');
await page.waitForFunction(() => tensormass.state.opened.tetCount === 1176, null, { timeout: 60000 });
await page.evaluate(() => tensormass.fresh(25));
await page.waitForFunction(() => tensormass.state.ran, null, { timeout: 60000 });
seen.ran = await page.evaluate(() => tensormass.state.ran);

const [phone] = await opened({ viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, hasTouch: true, isMobile: engine === chromium || undefined, colorScheme: 'dark' });
await phone.waitForTimeout(2000);
seen.overflow = await phone.evaluate(() => document.documentElement.scrollWidth - innerWidth);
await picture(phone, `${folder}/phone.png`);
console.log(JSON.stringify(seen));
await app.close();
