// Writes the screenshots of docs/view.md: node shots.mjs PROGRAM VILLAGE.txt FOLDER.
import { dirname, basename, join, resolve } from 'node:path';
import { exactAfter, launch, serve, until } from './browser.mjs';

const [program, village, out] = process.argv.slice(2);
const browser = await launch();
const server = await serve(resolve(program), dirname(resolve(village)), [basename(village), '--classes', '!7']);
const page = await browser.newPage({ viewport: { width: 1080, height: 640 } });
const shot = (name) => page.screenshot({ path: join(out, `${name}.png`) });
await page.goto(server.url);
await until(page, 'the first exact image', () => window.surfelStats.exact);
await exactAfter(page, () => page.locator('#image').press('ArrowUp'));
await page.evaluate(() => document.activeElement.blur());
await shot('view');
await exactAfter(page, () => page.getByLabel('Colour by').selectOption('classification'));
await page.evaluate(() => document.activeElement.blur());
await shot('view-classes');
await exactAfter(page, () => page.getByLabel('Colour by').selectOption(''));
const box = await page.locator('#image').boundingBox();
for (const [x, y] of [[0.42, 0.5], [0.6, 0.55]]) {
  await page.evaluate(() => { window.surfelStats.picked = undefined; });
  await page.mouse.click(box.x + box.width * x, box.y + box.height * y);
  await until(page, 'a pick', () => window.surfelStats.picked);
}
const trimmed = () => page.evaluate(() => document.activeElement.blur());
await page.evaluate(() => document.querySelectorAll('#panels details').forEach((d) => { d.open = d.firstElementChild.textContent === 'Pick'; }));
await trimmed();
await shot('view-pick');
await page.getByRole('button', { name: 'Clear picks' }).click();
await page.evaluate(() => document.querySelectorAll('#panels details').forEach((d) => { d.open = d.id === 'comparing'; }));
await page.locator('#other-name').selectOption('shader');
await exactAfter(page, () => page.locator('#other-value select').selectOption('normal'));
await page.getByRole('button', { name: 'Measure' }).click();
await until(page, 'a difference', () => window.surfelStats.compared);
await page.waitForTimeout(500);
await trimmed();
await shot('view-compare');
await browser.close();
await server.stop();
