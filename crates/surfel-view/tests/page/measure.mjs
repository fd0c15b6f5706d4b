// Measures `surfel view` in headless Chromium: node measure.mjs PROGRAM FILE [FLAG...]. Prints the results as a line of
// JSON.
import { readFileSync } from 'node:fs';
import { loadavg } from 'node:os';
import { basename } from 'node:path';
import { exactAfter, launch, serve, until } from './browser.mjs';

const [program, ...words] = process.argv.slice(2);
const browser = await launch();
const server = await serve(program, '.', words);
const page = await browser.newPage({ viewport: { width: 1344, height: 826 } });
const opened = performance.now();
await page.goto(server.url);
await until(page, 'the first image', () => window.surfelStats.first);
const first = performance.now();
await until(page, 'the first exact image', () => window.surfelStats.exact);
const exact = performance.now();
// Changes the window so that the image has 1024×768 pixels.
await exactAfter(page, async () => {
  const box = await page.locator('#stage').boundingBox();
  await page.setViewportSize({ width: 1344 + 1024 - Math.round(box.width), height: 826 + 768 - Math.round(box.height) });
});
const box = await page.locator('#image').boundingBox();
await page.evaluate(() => { window.surfelStats.latencies = []; window.surfelStats.frames = []; window.surfelStats.stills = []; window.surfelStats.server = []; });
const stills = [];
for (let round = 0; round < 5; round += 1) {
  const x = box.x + 200;
  await page.mouse.move(x, box.y + 300);
  await page.mouse.down();
  // The pointer moves about 60 times a second.
  for (let i = 0; i < 90; i += 1) {
    await page.mouse.move(x + 4 * i, box.y + 300 + 20 * Math.sin(i / 9));
    await new Promise((resolve) => setTimeout(resolve, 14));
  }
  await page.mouse.up();
  const last = performance.now();
  const before = await page.evaluate(() => window.surfelStats.exact);
  await until(page, 'a still image', (id) => window.surfelStats.exact > id && window.surfelIsStill(), before);
  stills.push(performance.now() - last);
}
const stats = await page.evaluate(() => window.surfelStats);
const ticks = () => { const fields = readFileSync(`/proc/${server.child.pid}/stat`, 'utf8').split(') ')[1].split(' '); return Number(fields[11]) + Number(fields[12]); };
const idleFrom = ticks();
await new Promise((resolve) => setTimeout(resolve, 5000));
const idle = (ticks() - idleFrom) / 5;
const session = await page.context().newCDPSession(page);
await session.send('HeapProfiler.collectGarbage');
const { usedSize } = await session.send('Runtime.getHeapUsage');
const sorted = (list) => [...list].sort((a, b) => a - b);
const at = (list, part) => sorted(list)[Math.min(list.length - 1, Math.floor(part * list.length))] ?? NaN;
const gaps = stats.frames.slice(1).map((t, i) => t - stats.frames[i]).filter((gap) => gap < 400);
const result = {
  file: basename(words[0]), first_ms: Math.round(first - server.started), first_in_page_ms: Math.round(first - opened), first_exact_ms: Math.round(exact - server.started),
  latency_median_ms: Math.round(at(stats.latencies, 0.5)), latency_95_ms: Math.round(at(stats.latencies, 0.95)),
  server_median_ms: Math.round(at(stats.server, 0.5)), images_a_second: Math.round(10 * 1000 / (gaps.reduce((a, b) => a + b, 0) / gaps.length)) / 10,
  still_after_input_ms: Math.round(at(stills, 0.5)), idle_cpu_percent: idle, heap_mb: Math.round(usedSize / 1e5) / 10, load: loadavg()[0].toFixed(1),
};
console.log(JSON.stringify(result));
await browser.close();
await server.stop();
