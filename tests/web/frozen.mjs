// Freezes a thread, the page or its process while a device feels a force: node frozen.mjs PUPPETEER CHROMIUM URL HAPLY_URL
// -> JSON: for each case the times, us of the monotonic clock, before and after it was frozen, and when it went on.
import { launch, takeDevice } from './browser.mjs';

const [, , puppeteer, executablePath, url, haply] = process.argv, seen = {};
const now_us = () => Number(process.hrtime.bigint() / 1000n), wait = (ms) => new Promise((r) => setTimeout(r, ms));
const app = await launch(puppeteer, executablePath), WAIT = { timeout: 40000, polling: 50 };

async function touching() {
  const page = await app.newPage();
  await page.setViewport({ width: 500, height: 300 });
  await page.goto(`${url}?scene=block-press`, { waitUntil: 'load' });
  await page.waitForFunction(() => globalThis.tensormass?.state.last && tensormass.state.law, WAIT); // the law's first state places the tip
  await takeDevice(page, haply);
  await felt(page);
  return page;
}
const felt = (page) => page.waitForFunction(() => tensormass.state.force?.sent_N > 0.1, WAIT).catch(async (error) => {
  console.error(JSON.stringify(seen), now_us());
  console.error(await page.evaluate(() => JSON.stringify([document.getElementById('device').textContent, tensormass.state.law.state, tensormass.state.law.fault, tensormass.state.law.vector])));
  throw error;
});

async function during(name, freeze, go) {
  const before = now_us();
  await freeze();
  const after = now_us();
  await wait(700);
  seen[name] = { before, after, end: now_us() };
  await go();
}

let page = await touching();
for (const worker of page.workers().filter((w) => /law.worker/.test(w.url()))) {
  await worker.client.send('Debugger.enable');
  // It stops at the next line that runs.
  await during('law', () => new Promise((paused) => { worker.client.once('Debugger.paused', paused); worker.client.send('Debugger.pause'); }), () => worker.client.send('Debugger.resume'));
  await worker.client.send('Debugger.disable');
}
await felt(page);
const session = await page.createCDPSession();
await session.send('Debugger.enable');
await during('page', () => new Promise((paused) => { session.once('Debugger.paused', paused); session.send('Debugger.pause'); }), () => session.send('Debugger.resume'));
await session.send('Debugger.disable');
await felt(page);
await during('hidden', () => page.evaluate(() => {
  Object.defineProperty(document, 'hidden', { value: true, configurable: true });
  document.dispatchEvent(new Event('visibilitychange'));
}), () => page.evaluate(() => {
  Object.defineProperty(document, 'hidden', { value: false, configurable: true });
  document.dispatchEvent(new Event('visibilitychange'));
}));
await felt(page);
await session.send('Emulation.setCPUThrottlingRate', { rate: 20 });
await wait(1000);
seen.throttled = await page.evaluate(() => tensormass.state.force);
await session.send('Emulation.setCPUThrottlingRate', { rate: 1 });
await felt(page);
// The page's process: of all renderers the one that computed most.
const { processInfo } = await (await app.target().createCDPSession()).send('SystemInfo.getProcessInfo');
const { id } = processInfo.filter((p) => p.type === 'renderer').sort((a, b) => b.cpuTime - a.cpuTime)[0];
await during('process', async () => process.kill(id, 'SIGSTOP'), async () => process.kill(id, 'SIGCONT'));
await felt(page);
await during('frozen', () => session.send('Page.setWebLifecycleState', { state: 'frozen' }), () => session.send('Page.setWebLifecycleState', { state: 'active' }));
await page.close();
page = await touching();
await during('closed', () => page.close(), async () => {});
await app.close();
console.log(JSON.stringify(seen));
