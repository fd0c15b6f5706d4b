// Tests the widget in JupyterLab: node lab.mjs URL NOTEBOOK [FOLDER for screenshots]. The server runs already.
import assert from 'node:assert/strict';
import { join } from 'node:path';
import { launch, until } from './browser.mjs';
const [url, notebook, shots] = process.argv.slice(2);
const browser = await launch();
try {
  const page = await browser.newPage({ viewport: { width: 1300, height: 900 } });
  await page.goto(`${url}/lab/tree/${notebook}?token=t`);
  await page.waitForSelector('.jp-Notebook', { timeout: 60_000 });
  await page.waitForTimeout(3000);
  await page.click('.jp-Notebook .jp-Cell');
  await page.keyboard.press('Control+Enter');
  const frame = await (await page.waitForSelector('iframe[title=Scene]', { timeout: 60_000 })).contentFrame();
  await until(frame, 'an exact image', () => window.surfelStats?.exact);
  await page.waitForTimeout(500);
  if (shots) await page.screenshot({ path: join(shots, 'lab.png') });
  const before = await frame.evaluate(() => window.surfelStats.exact);
  const box = await (await page.$('iframe[title=Scene]')).boundingBox();
  await page.mouse.move(box.x + 200, box.y + 200);
  await page.mouse.down();
  for (let i = 0; i < 10; i += 1) await page.mouse.move(box.x + 200 + 8 * i, box.y + 200);
  await page.mouse.up();
  await until(frame, 'an exact image', (id) => window.surfelStats.exact > id && window.surfelIsStill(), before);
  if (shots) await page.screenshot({ path: join(shots, 'lab-turned.png') });
  console.log('the widget passed');
} finally { await browser.close(); }
