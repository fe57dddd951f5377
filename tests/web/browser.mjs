// Launches a browser for the tests: Chromium headless, which draws with the processor where there is no GPU, or Firefox on the screen that xvfb-run gives.
import path from 'node:path';
import { pathToFileURL } from 'node:url';

export async function launch(puppeteer, executablePath, more = []) {
  const { default: engine } = await import(pathToFileURL(path.join(puppeteer, 'lib/puppeteer/puppeteer-core.js')));
  const firefox = executablePath.includes('firefox');
  // Chromium's own features, also those that puppeteer disables: a frame without an origin then has its own process, as users have it.
  const disabled = firefox ? [] : (await engine.defaultArgs({ browser: 'chrome' })).filter((a) => a.startsWith('--disable-features'));
  return engine.launch({
    executablePath, headless: !firefox, extraPrefsFirefox: { 'webgl.force-enabled': true }, browser: firefox ? 'firefox' : 'chrome', protocolTimeout: 180000, ignoreDefaultArgs: disabled,
    args: firefox ? [] : ['--no-sandbox', '--enable-unsafe-swiftshader', '--disable-background-networking', '--disable-component-update', '--disable-sync',
      '--no-first-run', '--disable-background-timer-throttling', '--disable-renderer-backgrounding', ...more],
  });
}

// Places the instrument in the block of block-press, then gives it to a device: the service's hand moves only once.
export const takeDevice = (page, service) => page.evaluate((address) => {
  tensormass.state.poses[0].tip_m = [0.052, 0.05, 0.05];
  document.getElementById('take').click();
  document.getElementById('service').value = address;
  document.getElementById('connect').click();
}, service);
