// Functions for tests: start a server of `surfel view`, and open its page in headless Chromium.
import { chromium } from 'playwright-core';
import { spawn } from 'node:child_process';
import { createInterface } from 'node:readline';

const ARGS = ['--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
  '--disable-component-update', '--disable-sync', '--force-color-profile=srgb'];

export const launch = () => chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', headless: true, args: ARGS,
});

/** Starts `surfel view` in a folder; resolves with its address once it is printed. */
export async function serve(program, folder, words) {
  const started = performance.now();
  const child = spawn(program, ['view', '--no-open', '--backend', 'cpu', ...words], { cwd: folder, stdio: ['ignore', 'pipe', 'ignore'] });
  process.once('exit', () => child.kill());
  const [url] = await new Promise((resolve, reject) => {
    child.once('exit', (code) => reject(new Error(`surfel view ended with ${code}`)));
    createInterface(child.stdout).once('line', (line) => resolve([line]));
  });
  return { url, child, started, stop: () => new Promise((resolve) => { child.once('exit', resolve); child.kill('SIGTERM'); }) };
}

/** Waits until a function in the page returns something true. */
export async function until(page, what, test, argument) {
  try {
    await page.waitForFunction(test, argument, { timeout: 60_000, polling: 20 });
  } catch (error) {
    throw new Error(`${what}: ${error.message}\nstatus: ${await page.textContent('#status').catch(() => '?')}`);
  }
}

/** Waits for the exact image that follows an action. */
export async function exactAfter(page, action) {
  const before = await page.evaluate(() => window.surfelStats.exact ?? 0);
  await action();
  await until(page, 'an exact image', (id) => (window.surfelStats.exact ?? 0) > id && window.surfelIsStill(), before);
}
