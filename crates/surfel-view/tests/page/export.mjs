// Tests exported pages in headless Chromium, from disk: node export.mjs PROGRAM [FOLDER for screenshots].
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdirSync, mkdtempSync, readFileSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { exactAfter, launch, until } from './browser.mjs';
import { hill } from './hill.mjs';
import { decoded } from './png.mjs';

const program = resolve(process.argv[2]);
const shots = process.argv[3] && resolve(process.argv[3]);
if (shots) mkdirSync(shots, { recursive: true });
const folder = mkdtempSync(join(tmpdir(), 'surfel-export-'));
const surfel = (...words) => execFileSync(program, words, { cwd: folder, stdio: ['ignore', 'pipe', 'inherit'] });
const step = async (name, action) => { await action(); console.log(`ok: ${name}`); };

/** Compares the canvas with the image of the copied command. */
async function compare(page) {
  const shown = await page.evaluate(async () => {
    const canvas = document.getElementById('image');
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    let text = '';
    for (let at = 0; at < data.length; at += 32768) text += String.fromCharCode(...data.subarray(at, at + 32768));
    return { width: canvas.width, height: canvas.height, pixels: btoa(text) };
  });
  // The text of an earlier copy is removed, so that the wait below ends with the new one.
  await page.evaluate(() => { document.getElementById('copied').value = ''; });
  await page.getByRole('button', { name: 'Copy command' }).click();
  await page.waitForFunction(() => !document.getElementById('copied').hidden && document.getElementById('copied').value.startsWith('surfel render'));
  const command = await page.inputValue('#copied');
  // The command is run by a shell, as a user would.
  const run = command.replace('surfel render', '"$0" render').replace(' -o view.png', ' -f -q --backend cpu -o native.png');
  execFileSync('sh', ['-c', run, program], { cwd: folder, stdio: ['ignore', 'pipe', 'inherit'] });
  const native = decoded(readFileSync(join(folder, 'native.png')));
  assert.deepEqual([shown.width, shown.height], [native.width, native.height]);
  const pixels = Buffer.from(shown.pixels, 'base64');
  const differing = pixels.filter((x, i) => x !== native.pixels[i]).length;
  assert.equal(differing, 0, `${differing} bytes differ: ${command}`);
}

/** Serves a folder with ranges; counts the bytes that are sent of each file. */
async function serve(root, takesRanges = true) {
  const sent = {};
  const server = createServer((request, response) => {
    const name = decodeURIComponent(request.url.slice(1).split('?')[0]) || 'index.html';
    let bytes;
    try { bytes = readFileSync(join(root, name)); } catch { return response.writeHead(404).end(); }
    const range = takesRanges && /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? '');
    const part = range ? bytes.subarray(Number(range[1]), Number(range[2]) + 1) : bytes;
    sent[name] = { requests: (sent[name]?.requests ?? 0) + 1, bytes: (sent[name]?.bytes ?? 0) + part.length };
    const type = name.endsWith('.html') ? 'text/html' : 'application/octet-stream';
    const headers = range ? { 'Content-Range': `bytes ${range[1]}-${range[2]}/${bytes.length}` } : {};
    response.writeHead(range ? 206 : 200, { 'Content-Type': type, 'Content-Length': part.length, ...headers }).end(part);
  });
  await new Promise((listening) => server.listen(0, '127.0.0.1', listening));
  return { sent, url: `http://127.0.0.1:${server.address().port}/`, close: () => server.close() };
}

/** Opens a page, and returns it with its errors. */
async function open(browser, url) {
  const context = await browser.newContext({ viewport: { width: 1000, height: 700 } });
  const page = await context.newPage();
  const complaints = [];
  page.on('pageerror', (error) => complaints.push(error.message));
  page.on('console', (message) => message.type() === 'error' && complaints.push(message.text()));
  await page.goto(url);
  return { page, complaints };
}

/** Tests a folder with a COPC file, of which the page reads parts. */
async function runFolder(browser) {
  const side = Number(process.env.SURFEL_SIDE ?? 700);
  writeFileSync(join(folder, 'tile.txt'), hill(side));
  surfel('convert', 'tile.txt', '-q', '-f', '-o', 'tile.copc.laz');
  surfel('view', 'tile.copc.laz', '--export', 'site', '--lod-error', '4', '-q');
  const site = join(folder, 'site');
  const whole = statSync(join(site, 'tile.copc.laz')).size;
  const served = await serve(site);
  await step('a COPC file is read by ranges, and the image is the program\u2019s', async () => {
    const start = performance.now();
    const { page, complaints } = await open(browser, served.url);
    await until(page, 'the first exact image', () => window.surfelStats.exact);
    const { requests, bytes } = served.sent['tile.copc.laz'];
    console.log(`${side * side} points: first image after ${((performance.now() - start) / 1000).toFixed(2)} s, ${requests} requests, ${bytes} of ${whole} bytes`);
    assert.ok(bytes < 0.7 * whole, 'a part of the file is read');
    assert.ok(!served.sent['emulated.wasm'] || !served.sent['fused.wasm'], 'one module is read');
    await compare(page);
    await exactAfter(page, async () => { await page.mouse.move(300, 300); await page.mouse.wheel(0, -1500); });
    await compare(page);
    assert.ok(served.sent['tile.copc.laz'].bytes > bytes, 'a nearer view reads more');
    if (shots) await page.screenshot({ path: join(shots, 'export-copc.png') });
    assert.deepEqual(complaints, []);
  });
  served.close();
  const plain = await serve(site, false);
  await step('a server without ranges, and a folder on disk, have a message', async () => {
    const { page } = await open(browser, plain.url);
    await until(page, 'a message', () => document.getElementById('status').textContent.includes('no ranges'));
    const { page: onDisk } = await open(browser, `file://${join(site, 'index.html')}`);
    await until(onDisk, 'a message', () => document.getElementById('status').textContent.includes('from a web server only'));
  });
  plain.close();
  await step('a file of another format is read whole from beside the page', async () => {
    surfel('view', 'hill.txt', '--export', 'site', '-f', '-q');
    const again = await serve(site);
    const { page } = await open(browser, again.url);
    await until(page, 'the first exact image', () => window.surfelStats.exact);
    await compare(page);
    assert.equal(again.sent['hill.txt'].requests, 1);
    again.close();
  });
}

async function run(browser) {
  writeFileSync(join(folder, 'hill.txt'), hill(100));
  writeFileSync(join(folder, 'other.txt'), hill(50));
  surfel('view', 'hill.txt', '--export', 'page.html', '--color-by', 'intensity', '-q');
  console.log(`page.html: ${statSync(join(folder, 'page.html')).size} bytes`);
  const context = await browser.newContext({ viewport: { width: 1000, height: 700 } });
  const page = await context.newPage();
  const [complaints, requests] = [[], []];
  page.on('pageerror', (error) => complaints.push(error.message));
  page.on('console', (message) => message.type() === 'error' && complaints.push(message.text()));
  page.on('request', (request) => requests.push(request.url().slice(0, 40)));
  const start = performance.now();
  await page.goto(`file://${join(folder, 'page.html')}`);
  await until(page, 'the first exact image', () => window.surfelStats.exact);
  console.log(`first image after ${((performance.now() - start) / 1000).toFixed(2)} s`);
  const shot = (name) => shots && page.screenshot({ path: join(shots, `${name}.png`) });
  await step('the first image is the program\u2019s, to the bit', async () => { await shot('export'); await compare(page); });
  await step('orbit and zoom', async () => {
    await exactAfter(page, async () => {
      await page.mouse.move(300, 300);
      await page.mouse.down();
      for (let i = 0; i < 20; i += 1) await page.mouse.move(300 + 6 * i, 300 + 2 * i);
      await page.mouse.up();
    });
    await exactAfter(page, async () => { await page.mouse.wheel(0, -300); });
    assert.ok(await page.evaluate(() => window.surfelStats.latencies.length > 0), 'images while it moves');
    await compare(page);
  });
  await step('colour by class, hide a class', async () => {
    await exactAfter(page, () => page.getByLabel('Colour by').first().selectOption('classification'));
    await exactAfter(page, () => page.locator('#classes input').first().uncheck());
    await compare(page);
    await shot('export-classes');
  });
  await step('pick', async () => {
    await page.locator('#image').focus();
    await page.keyboard.press('p');
    await until(page, 'a pick', () => window.surfelStats.picked);
  });
  await step('drop a file', async () => {
    const bytes = readFileSync(join(folder, 'other.txt')).toString('base64');
    const before = await page.textContent('#title');
    await page.evaluate((text) => {
      const file = new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], 'other.txt');
      const dataTransfer = new DataTransfer();
      dataTransfer.items.add(file);
      document.body.dispatchEvent(new DragEvent('drop', { dataTransfer, bubbles: true, cancelable: true }));
    }, bytes);
    await until(page, 'the other file', () => document.getElementById('title').textContent.includes('other.txt') && window.surfelIsStill() && window.surfelStats.exact);
    assert.notEqual(await page.textContent('#title'), before);
    await compare(page);
  });
  await step('a broken file has a message', async () => {
    await page.evaluate(() => {
      const dataTransfer = new DataTransfer();
      dataTransfer.items.add(new File(['no splats'], 'broken.ply'));
      document.body.dispatchEvent(new DragEvent('drop', { dataTransfer, bubbles: true, cancelable: true }));
    });
    await until(page, 'a message', () => document.getElementById('status').classList.contains('bad'));
  });
  const elsewhere = requests.filter((url) => !/^(file|blob|data):/.test(url));
  assert.deepEqual(elsewhere, [], 'the page asks nobody');
  assert.deepEqual(complaints, []);
}

const browser = await launch();
try {
  await run(browser);
  await runFolder(browser);
  console.log('all passed');
} finally {
  await browser.close();
  rmSync(folder, { recursive: true, force: true });
}
