// Tests the page of `surfel view` in headless Chromium: node test.mjs PROGRAM [FOLDER for screenshots].
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { exactAfter, launch, serve, until } from './browser.mjs';
import { hill } from './hill.mjs';

const program = resolve(process.argv[2]);
const shots = process.argv[3] && resolve(process.argv[3]);
if (shots) mkdirSync(shots, { recursive: true });
const folder = mkdtempSync(join(tmpdir(), 'surfel-page-'));
const axe = readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');

const state = (page) => page.evaluate(() => JSON.parse(decodeURIComponent(location.hash.slice(1) || '%7B%7D')));
const shot = (page, name) => shots && page.screenshot({ path: join(shots, `${name}.png`) });
const step = async (name, action) => { await action(); console.log(`ok: ${name}`); };

async function checkAccess(page, what) {
  await page.evaluate(axe);
  const found = await page.evaluate(() => globalThis.axe.run(document));
  const problems = found.violations.map((v) => `${v.id}: ${v.help} (${v.nodes.map((n) => n.target).join('; ')})`);
  assert.deepEqual(problems, [], what);
}

async function run(browser) {
  let server = await serve(program, folder, ['hill.txt']);
  const context = await browser.newContext({ viewport: { width: 1100, height: 760 }, permissions: ['clipboard-read', 'clipboard-write'] });
  const page = await context.newPage();
  const complaints = [];
  page.on('pageerror', (error) => complaints.push(error.message));

  await step('open: an image, and no token in the address', async () => {
    await page.goto(server.url);
    await until(page, 'the first exact image', () => window.surfelStats.exact);
    assert.ok(!page.url().includes('token'), page.url());
    assert.ok(await page.evaluate(() => { const c = document.getElementById('image'); const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; return d.some((x, i) => i % 4 < 3 && x < 200); }));
    await shot(page, 'open');
  });
  await step('orbit, pan and zoom by pointer', async () => {
    await exactAfter(page, async () => {
      await page.mouse.move(300, 300);
      await page.mouse.down();
      for (let i = 0; i < 20; i += 1) await page.mouse.move(300 + 6 * i, 300 + 2 * i);
      await page.mouse.up();
    });
    const before = await state(page);
    assert.ok(before.eye && before.target && await page.evaluate(() => window.surfelStats.latencies.length > 0));
    await exactAfter(page, async () => { await page.mouse.move(200, 250); await page.mouse.wheel(0, -300); });
    const zoomed = await state(page);
    assert.notEqual(zoomed.eye, before.eye);
    await exactAfter(page, async () => {
      await page.keyboard.down('Shift');
      await page.mouse.down();
      for (let i = 0; i < 9; i += 1) await page.mouse.move(200 + 6 * i, 250);
      await page.mouse.up();
      await page.keyboard.up('Shift');
    });
    assert.notEqual((await state(page)).target, zoomed.target);
  });
  await step('pick a known point', async () => {
    const z = Math.sin(1.3 * 3) * 0.4 + Math.cos(0.9 * 3) * 0.5;
    const seen = { eye: `3,3,${z + 2}`, target: `3,3,${z}`, 'camera-up': '0,1,0' };
    await exactAfter(page, () => page.evaluate((s) => { location.hash = encodeURIComponent(JSON.stringify(s)); }, seen));
    const box = await page.locator('#image').boundingBox();
    await page.mouse.click(box.x + box.width / 2, box.y + box.height / 2);
    await until(page, 'a pick', () => window.surfelStats.picked);
    const picked = await page.evaluate(() => window.surfelStats.picked);
    assert.equal(picked.row, 5050);
    assert.equal(picked.values.classification, 5);
    await page.mouse.click(box.x + box.width / 2 + 60, box.y + box.height / 2);
    await until(page, 'a distance', () => document.getElementById('picked').textContent.includes('Distance A–B'));
    await shot(page, 'pick');
  });
  await step('colour by class, with a legend', async () => {
    await exactAfter(page, () => page.getByRole('button', { name: 'Iso', exact: true }).click());
    await exactAfter(page, () => page.getByLabel('Colour by').selectOption('classification'));
    assert.match(await page.textContent('#legend'), /2 ground/);
    await shot(page, 'classes');
  });
  await step('hide a class', async () => {
    await exactAfter(page, () => page.getByLabel(/^2 ground/).uncheck());
    assert.equal((await state(page)).classes, '!2');
    assert.match(await page.textContent('#status'), /7,000 splats/);
  });
  await step('section', async () => {
    await page.locator('summary', { hasText: 'Clip and section' }).click();
    await exactAfter(page, () => page.getByLabel('Section along').selectOption('1'));
    assert.equal((await state(page)).crop.split(',').length, 6);
    await shot(page, 'section');
  });
  await step('the copied command writes the same bytes', async () => {
    await page.getByRole('button', { name: 'Copy command' }).click();
    await until(page, 'the command', () => document.getElementById('copied').value.startsWith('surfel render'));
    const command = await page.inputValue('#copied');
    execFileSync('/bin/sh', ['-c', `${command.replace(/^surfel/, `'${program}'`)} -f -q --backend cpu`], { cwd: folder });
    const shown = await page.evaluate(async () => {
      const bytes = new Uint8Array(await window.surfelStats.file.arrayBuffer());
      return btoa(Array.from(bytes, (b) => String.fromCharCode(b)).join(''));
    });
    assert.ok(readFileSync(join(folder, 'view.png')).equals(Buffer.from(shown, 'base64')), command);
  });
  await step('compare two settings', async () => {
    await page.locator('#comparing > summary').click();
    await page.locator('#other-name').selectOption('shader');
    await exactAfter(page, () => page.locator('#other-value select').selectOption('normal'));
    await page.getByRole('button', { name: 'Measure' }).click();
    await until(page, 'a difference', () => window.surfelStats.compared);
    assert.match(await page.textContent('#measured'), /FLIP/);
    await shot(page, 'compare');
    await page.getByRole('button', { name: 'End' }).click();
  });
  await step('wrong way up', async () => {
    await exactAfter(page, () => page.getByRole('button', { name: 'Wrong way up?' }).click());
    assert.ok((await state(page)).up);
  });
  await step('keep a view and go back to it', async () => {
    await page.getByLabel('Name of this view').fill('first');
    await page.getByRole('button', { name: 'Keep view' }).click();
    const before = await state(page);
    await exactAfter(page, () => page.getByRole('button', { name: 'Top', exact: true }).click());
    await exactAfter(page, () => page.getByRole('button', { name: 'first', exact: true }).click());
    assert.deepEqual(await state(page), before);
  });
  await step('copy a path through two kept views', async () => {
    assert.ok(await page.locator('#copy-path').isHidden());
    await exactAfter(page, () => page.getByRole('button', { name: 'Right', exact: true }).click());
    await page.getByLabel('Name of this view').fill('second');
    await page.getByRole('button', { name: 'Keep view' }).click();
    await page.getByRole('button', { name: 'Copy path' }).click();
    await until(page, 'the path', () => document.getElementById('copied').value.includes('"keys"'));
    const input = JSON.parse(await page.inputValue('#copied')).keys;
    assert.deepEqual(input.map(({ name }) => name), ['first', 'second']);
    assert.notDeepEqual(input[0].camera.eye, input[1].camera.eye);
  });
  await step('everything by keyboard', async () => {
    const base = page.url().split('#')[0];
    await page.goto('about:blank');
    await page.goto(`${base}#${encodeURIComponent('{}')}`);
    await until(page, 'an exact image', () => window.surfelStats?.exact);
    await page.keyboard.press('Tab');
    assert.equal(await page.evaluate(() => document.activeElement.id), 'image');
    await exactAfter(page, () => page.keyboard.press('ArrowLeft'));
    const { eye } = await state(page);
    await exactAfter(page, () => page.keyboard.press('+'));
    assert.notEqual((await state(page)).eye, eye);
    await exactAfter(page, () => page.keyboard.press('7'));
    assert.equal((await state(page)).view, 'top');
    await page.evaluate(() => { window.surfelStats.picked = undefined; });
    await page.keyboard.press('p');
    await until(page, 'a pick by key', () => window.surfelStats.picked);
    await page.keyboard.press('h');
    assert.ok(await page.evaluate(() => document.getElementById('help').open));
    await shot(page, 'keys');
    await page.keyboard.press('Escape');
    for (let i = 0; i < 12; i += 1) await page.keyboard.press('Tab');
    assert.notEqual(await page.evaluate(() => document.activeElement.tagName), 'BODY');
  });
  await step('axe-core finds nothing, in light and dark', async () => {
    await page.evaluate(() => document.querySelectorAll('details').forEach((details) => { details.open = true; }));
    for (const colorScheme of ['light', 'dark']) {
      await page.emulateMedia({ colorScheme });
      await checkAccess(page, colorScheme);
    }
    await shot(page, 'dark');
    await page.emulateMedia({ colorScheme: 'light' });
  });
  await step('320 pixels wide', async () => {
    await page.setViewportSize({ width: 320, height: 640 });
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= 320));
    await checkAccess(page, '320 pixels');
    await shot(page, 'narrow');
    await page.setViewportSize({ width: 1100, height: 760 });
  });
  await step('the server goes away and comes back', async () => {
    const port = new URL(server.url).port;
    await server.stop();
    await until(page, 'the message', () => document.getElementById('status').textContent.includes('gone'));
    server = await serve(program, folder, ['hill.txt', '--port', port]);
    await until(page, 'the advice', () => document.getElementById('status').textContent.includes('new address'));
    await page.goto(server.url);
    await until(page, 'an exact image', () => window.surfelStats?.exact);
  });
  await step('compare two files', async () => {
    writeFileSync(join(folder, 'tall.txt'), readFileSync(join(folder, 'hill.txt'), 'utf8').replace(/^(\S+ \S+) (-?[\d.]+)/gm, (_, xy, z) => `${xy} ${z * 1.5}`));
    const both = await serve(program, folder, ['hill.txt', 'tall.txt']);
    const page = await context.newPage();
    page.on('pageerror', (error) => complaints.push(error.message));
    await page.goto(both.url);
    await until(page, 'an exact image', () => window.surfelStats?.exact);
    await page.locator('#comparing > summary').click();
    await exactAfter(page, () => page.locator('#other-name').selectOption('input'));
    const measured = async () => {
      await page.evaluate(() => { window.surfelStats.compared = null; });
      await page.getByRole('button', { name: 'Measure' }).click();
      await until(page, 'a difference', () => window.surfelStats.compared);
      return page.evaluate(() => window.surfelStats.compared);
    };
    assert.ok((await measured()).rmse > 0.01);
    await shot(page, 'compare-files');
    await exactAfter(page, () => page.getByLabel('File at the left').selectOption('tall.txt'));
    assert.equal((await measured()).psnr, null, 'a file is equal to itself');
    await page.close();
    await both.stop();
  });
  await step('memory of the page', async () => {
    const session = await context.newCDPSession(page);
    await session.send('HeapProfiler.collectGarbage');
    const { usedSize } = await session.send('Runtime.getHeapUsage');
    assert.ok(usedSize < 80e6, `${usedSize} bytes`);
  });
  await step('a broken file shows its message', async () => {
    writeFileSync(join(folder, 'broken.ply'), 'ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nend_header\n1\n');
    const broken = await serve(program, folder, ['broken.ply']);
    const other = await context.newPage();
    await other.goto(broken.url);
    await until(other, 'the message', () => document.getElementById('status').textContent.includes('broken.ply'));
    await shot(other, 'broken');
    await other.close();
    await broken.stop();
  });
  assert.deepEqual(complaints, []);
  await server.stop();
}

writeFileSync(join(folder, 'hill.txt'), hill(100));
const browser = await launch();
try {
  await run(browser);
  console.log('the page passed');
} finally {
  await browser.close();
  rmSync(folder, { recursive: true, force: true });
}
