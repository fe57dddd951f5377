// Drives the page in a browser: node drive.mjs PUPPETEER BROWSER URL FOLDER HAPLY_URL MESH LOG TIED.yaml TIED.lcm -> JSON of what was seen; pictures in FOLDER.
import { readFile, writeFile } from 'node:fs/promises';

import { launch, takeDevice } from './browser.mjs';

const [, , puppeteer, executablePath, url, folder, haply, mesh, log, tied, tiedLog] = process.argv;
const firefox = executablePath.includes('firefox'), seen = { console: [] }, WAIT = { timeout: 120000, polling: 100 };
const app = await launch(puppeteer, executablePath);
const begun = Date.now(), step = (what) => console.error(`${((Date.now() - begun) / 1000).toFixed(1)} s: ${what}`);

async function opened(query, { width = 1000, height = 640, dark = false, scale = 1 } = {}) {
  const page = await app.newPage();
  page.on('console', (m) => { if (m.type() === 'error') { seen.console.push(m.text()); console.error(m.text()); } });
  page.on('pageerror', (e) => { seen.console.push(String(e)); console.error(e); });
  await page.setViewport({ width, height, deviceScaleFactor: scale, ...(width < 500 && !firefox ? { isMobile: true, hasTouch: true } : {}) });
  if (!firefox) await page.emulateMediaFeatures([{ name: 'prefers-color-scheme', value: dark ? 'dark' : 'light' }]);
  const from = Date.now();
  await page.goto(url + query, { waitUntil: 'load', timeout: 120000 });
  await page.waitForFunction(() => globalThis.tensormass?.state.last && tensormass.view.frames > 0, WAIT);
  return [page, Date.now() - from];
}
// Waits, 120 s at most, until f returns something; the value is of that very moment. A busy machine is slow, and a look after a fixed time says nothing.
const until = (page, f, ...given) => page.waitForFunction(f, WAIT, ...given).catch(async (error) => {
  console.error(`${f}: page says ${await page.evaluate(() => JSON.stringify([tensormass.state.error, document.getElementById('device').textContent, tensormass.state.law?.state, tensormass.state.law?.fault]))}`);
  throw error;
});
const valueOf = async (page, f, ...given) => (await until(page, f, ...given)).jsonValue();
const choose = (page, field, value) => page.evaluate((f, v) => {
  const element = document.querySelector(f);
  element.value = v;
  element.dispatchEvent(new Event('change'));
}, field, value);
const hide = (page, value) => page.evaluate((v) => {
  Object.defineProperty(document, 'hidden', { value: v, configurable: true });
  document.dispatchEvent(new Event('visibilitychange'));
}, value);
const give = (page, files) => page.evaluate((list) => {
  const all = new DataTransfer();
  for (const [name, base64] of list) all.items.add(new File([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))], name));
  const event = new Event('drop', { bubbles: true, cancelable: true });
  Object.defineProperty(event, 'dataTransfer', { value: all });
  dispatchEvent(event);
}, files);
const picture = (page, name) => page.screenshot({ path: `${folder}/${name}.png` });

// Small scene first: every check but the liver's.
let page = await app.newPage();
await page.goto(new URL('../three.html', url).href, { waitUntil: 'load', timeout: 120000 });
seen.example_N = await (await page.waitForFunction(() => globalThis.newest && Math.hypot(...newest.force_N) > 0.02 && Math.hypot(...newest.force_N), WAIT)).jsonValue();
await page.close();
step('the example');
[page] = await opened('?scene=block-press&hard=none');
step('a block');
seen.frames = await valueOf(page, () => tensormass.view.frames > 10 && tensormass.view.frames);
seen.stages = await valueOf(page, () => document.querySelectorAll('#stages tr').length > 2 && document.querySelectorAll('#stages tr').length);
seen.factor = await valueOf(page, () => Number(document.getElementById('factor').textContent) > 0 && document.getElementById('factor').textContent);
seen.controller = await valueOf(page, () => ['idle', 'engaged'].includes(tensormass.state.law?.state) && tensormass.state.law.state);

await page.evaluate(() => document.getElementById('take').click());
const before = await page.evaluate(() => [...tensormass.state.poses[0].tip_m]);
await page.evaluate(() => document.getElementById('view').focus());
for (let i = 0; i < 10; i++) await page.keyboard.press('PageDown');
const at = await page.evaluate(() => [...tensormass.state.poses[0].tip_m]);
await until(page, (tip) => Math.hypot(...tensormass.state.last.poses[0].tip_m.map((x, a) => x - tip[a])) < 1e-4, at);
seen.moved_m = Math.hypot(...at.map((x, a) => x - before[a]));
await page.evaluate(() => document.getElementById('take').click());
step('keys');

await page.evaluate(() => tensormass.fresh(25));
seen.ran = await valueOf(page, () => tensormass.state.ran);
step('scripted press');

await choose(page, '#choice-law', 'neo-hooke');
seen.price = await valueOf(page, () => /→/.test(document.getElementById('price-law').textContent) && document.getElementById('price-law').textContent);
await choose(page, '#choice-law', 'linear');
await choose(page, '#choice-hard', 'tremor');
seen.energy = await valueOf(page, () => tensormass.state.last.energy?.put_in_J > 1e-4 && tensormass.state.last.energy);
await choose(page, '#choice-hard', 'forged');
[seen.rejected, seen.largest_N] = await valueOf(page, () => {
  const largest_N = Math.max(...tensormass.state.law.force.filter((_, i) => i % 2));
  return !document.getElementById('rejected-row').hidden && largest_N > 0.1 && [document.getElementById('rejected').textContent, largest_N];
});
await choose(page, '#choice-hard', 'none');
step('hard cases');

// Every option of every choice opens, and the first again.
seen.opened = [];
for (const [name, options] of await page.evaluate(() => [...document.querySelectorAll('#choices select')].slice(2).map((s) => [s.id, [...s.options].map((o) => o.value)]))) {
  for (const value of [...options.slice(1), options[0]]) {
    if (value === 'incompressible' || value === 'smoothed') continue; // slow: thousands of steps a frame
    const built = await page.evaluate(() => tensormass.state.opened.number);
    await choose(page, `#${name}`, value);
    if (name !== 'choice-extrapolator') await until(page, (n) => tensormass.state.opened.number > n || document.getElementById('error').open, built);
    if (await page.evaluate(() => document.getElementById('error').open)) throw new Error(`${name}=${value}: ${await page.$eval('#error pre', (e) => e.textContent)}`);
    seen.opened.push(`${name}=${value}`);
  }
}
step('every choice');

await give(page, [['bad.msh', Buffer.from('$MeshFormat\nnonsense\n').toString('base64')]]);
await until(page, () => document.getElementById('error').open);
seen.error = await page.$eval('#error pre', (e) => e.textContent);
await page.evaluate(() => document.querySelector('#error button').click());
await give(page, [['own.msh', (await readFile(mesh)).toString('base64')]]);
seen.own = await valueOf(page, () => {
  const { opened, last } = tensormass.state, force_N = Math.hypot(...last.reactions[0].force_N);
  return opened.title === 'own.msh' && last.generation === opened.generation && force_N > 0.1 && [opened.tetCount, force_N];
});
step('own mesh');
await give(page, [['press.log', (await readFile(log)).toString('base64')]]);
seen.played = await valueOf(page, () => tensormass.state.played?.frame > 5 && [tensormass.state.played.frames, tensormass.state.played.triangles, document.getElementById('title').textContent]);
await page.evaluate(() => document.getElementById('live').click());
await until(page, () => !tensormass.state.played);
step('recorded session');
// Bodies with ties, live and recorded; the surface has more vertices after the cut.
await give(page, [['tied.yaml', (await readFile(tied)).toString('base64')], ['block_1k.msh', (await readFile(mesh)).toString('base64')]]);
const told = () => {
  const { state, view } = tensormass, ties = state.played?.ties ?? state.last?.ties;
  return ties && ties[0] < ties[1] && view.counts.ties === ties[0] && document.getElementById('ties').textContent === `${ties[0]} of ${ties[1]} hold` && ties;
};
seen.tied = await valueOf(page, told);
await picture(page, 'tied');
await give(page, [['tied.lcm', (await readFile(tiedLog)).toString('base64')]]);
await until(page, () => tensormass.state.played?.frame === tensormass.state.played?.frames - 1);
seen.tiedLog = await valueOf(page, told);
await picture(page, 'tied_log');
await page.evaluate(() => document.getElementById('live').click());
await until(page, () => !tensormass.state.played);
step('ties');
// Steps of 4 us: thousands a frame.
await give(page, [['slow.yaml', Buffer.from((await readFile(tied, 'utf8')).replace('time: {', 'time: {step: 4 us, ')).toString('base64')], ['block_1k.msh', (await readFile(mesh)).toString('base64')]]);
seen.slow = await valueOf(page, () => !document.getElementById('slow').hidden && document.getElementById('slow').textContent);
await picture(page, 'slow');
step('slow');

await hide(page, true);
seen.hidden = await valueOf(page, () => tensormass.state.law.state !== 'engaged' && Math.hypot(...tensormass.state.law.vector[0]) === 0 && [tensormass.state.law.state, 0]);
await hide(page, false);
await page.close();

// A device holds the instrument in the block; hidden, no force is sent.
[page] = await opened('?scene=block-press');
await takeDevice(page, haply);
await until(page, () => tensormass.state.device?.startsWith('Inverse3'));
seen.sent_N = await valueOf(page, () => tensormass.state.force?.sent_N > 0.1 && tensormass.state.force.sent_N);
await hide(page, true);
const sent = await valueOf(page, () => tensormass.state.force.sent_N === 0 && tensormass.state.force.sent);
await until(page, (n) => tensormass.state.force.sent > n + 50, sent);
await page.close();
step('device');

[page] = await opened('?scene=block-press');
// The instrument is placed in the block and stays there.
await page.evaluate(() => {
  ['supports', 'patch', 'rows'].forEach((kind) => document.getElementById(`show-${kind}`).click());
  tensormass.state.poses[0].tip_m = [0.052, 0.05, 0.048];
  document.getElementById('take').click();
});
// Supports, a patch, rows under a force; points of rows on the surface near the tip; their forces add up to about the reaction. The text is a moment older.
[seen.marks, seen.rows] = await valueOf(page, () => {
  const { rows, poses, reactions } = tensormass.state.last, marks = ['supports', 'patch', 'rows'].map((kind) => tensormass.view.counts[kind]), sum = [0, 0, 0];
  const text = document.getElementById('rows').textContent, resultant = reactions[0].resultant_N;
  let far = 0;
  for (let i = 0; i < rows.length; i += 7) {
    if (rows[i + 6] > 0) far = Math.max(far, Math.hypot(...poses[0].tip_m.map((x, a) => x - rows[i + a])));
    sum.forEach((_, a) => { sum[a] -= rows[i + 6] * rows[i + 3 + a]; });
  }
  return marks.every((n) => n >= 1) && marks[1] >= 3 && Math.hypot(...resultant) > 0.1 && /[1-9]\d* bear/.test(text) && [marks, { far, sum, resultant, text }];
});
await page.close();
step('marks');
// A hand that stays away from the tissue: frames go on, pictures do not, and the last one is sharp.
[page] = await opened('?scene=block-press');
await page.evaluate(() => {
  tensormass.state.poses[0].tip_m = [0.05, 0.05, 0.12];
  document.getElementById('take').click();
});
await until(page, () => tensormass.view.scale >= 0.99);
await new Promise((r) => setTimeout(r, 1500));
const rest = await page.evaluate(() => [tensormass.view.frames, tensormass.view.pictures]);
seen.still = await valueOf(page, (from) => tensormass.view.frames > from[0] + 10 && { frames: tensormass.view.frames - from[0], pictures: tensormass.view.pictures - from[1], scale: tensormass.view.scale }, rest);
seen.appeared = await page.evaluate(() => [tensormass.view.first_ms, tensormass.view.moving_ms]);
await page.close();
step('rest');
[page, seen.first_ms] = await opened('?scene=liver-press', { width: 1280, height: 800 });
await page.evaluate(() => document.getElementById('show-supports').click());
[seen.liver, seen.errors] = await valueOf(page, () => {
  const [figures, errors] = ['#figures td', '#choices .error'].map((what) => Object.fromEntries([...document.querySelectorAll(what)].map((c) => [c.id, c.textContent])));
  return errors['error-mesh'] && [figures, errors];
});
await picture(page, 'desktop');
await page.close();
step('liver');
// Two bodies; the choices that no part of them can have alone open too.
[page] = await opened('?scene=cholecystectomy');
seen.gallbladder = await valueOf(page, () => tensormass.state.last?.ties && [document.getElementById('tets').textContent, ...tensormass.state.last.ties, tensormass.state.sent.sets['bodies.gallbladder.effects']]);
await picture(page, 'gallbladder');
for (const [field, value] of [['viscosity', 'on'], ['viscosity', 'off'], ['law', 'rotation'], ['law', 'neo-hooke']]) {
  const built = await page.evaluate(() => tensormass.state.opened.number);
  await choose(page, `#choice-${field}`, value);
  await until(page, (n) => tensormass.state.opened.number > n || document.getElementById('error').open, built);
  if (await page.evaluate(() => document.getElementById('error').open)) throw new Error(`${field}=${value}: ${await page.$eval('#error pre', (e) => e.textContent)}`);
}
await page.close();
step('gallbladder');
[page] = await opened('?scene=liver-press&mesh=1%2C180%20tetrahedra', { width: 390, height: 844, dark: true, scale: 2 });
await until(page, () => tensormass.view.frames > 3 && Number(document.getElementById('factor').textContent) > 0);
seen.overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
await picture(page, 'phone');
await writeFile(`${folder}/seen.json`, JSON.stringify(seen));
await app.close();
console.log(JSON.stringify(seen));
