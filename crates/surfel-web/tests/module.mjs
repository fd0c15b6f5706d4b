// Tests the drawing module under node against the program: the pixels are equal to the bit.
// node [--experimental-wasm-relaxed-simd] module.mjs PROGRAM FUSED.wasm EMULATED.wasm [--time]
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { hill } from '../../surfel-view/tests/page/hill.mjs';
import { decoded } from '../../surfel-view/tests/page/png.mjs';

const [program, fused, emulated, ...flags] = process.argv.slice(2);
const page = new URL('../../surfel-view/page/module.js', import.meta.url);
const { isFused, SurfelModule } = new Function(`${readFileSync(page, 'utf8')}; return { isFused, SurfelModule };`)();
const spot = new URL('../../../assets/spot/spot.obj', import.meta.url).pathname;
const folder = mkdtempSync(join(tmpdir(), 'surfel-web-'));
const surfel = (...words) => execFileSync(resolve(program), words, { cwd: folder, maxBuffer: 1 << 28, stdio: ['ignore', 'pipe', 'inherit'] });

/** Returns trained Gaussians on a spiral, as ASCII PLY. */
function gaussians() {
  const names = ['x', 'y', 'z', 'f_dc_0', 'f_dc_1', 'f_dc_2', 'opacity', 'scale_0', 'scale_1', 'scale_2', 'rot_0', 'rot_1', 'rot_2', 'rot_3'];
  const rows = [];
  for (let i = 0; i < 3000; i += 1) {
    const [t, r] = [i * 0.02, 1 + (i % 7) * 0.05];
    rows.push([r * Math.cos(t), i * 0.001 - 1.5, r * Math.sin(t), Math.sin(i), Math.cos(i), Math.sin(3 * i), 1.5, -3.5, -3.2, -4.5, 0.9, 0.3, Math.sin(i) * 0.3, 0.1].map((x) => x.toFixed(5)).join(' '));
  }
  return `ply\nformat ascii 1.0\nelement vertex ${rows.length}\n${names.map((name) => `property float ${name}\n`).join('')}end_header\n${rows.join('\n')}\n`;
}

function load(path) {
  const bytes = readFileSync(path);
  return WebAssembly.validate(bytes) && new SurfelModule(new WebAssembly.Module(bytes));
}

/** Draws by a module; returns its pixels and header. */
function draw(module, state, size, moving = false) {
  const answer = module.answer({ do: 'draw', id: 1, layer: 0, state, size, moving });
  if (!(answer instanceof Uint8Array)) assert.fail(JSON.stringify(answer));
  const length = new DataView(answer.buffer, answer.byteOffset).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(answer.subarray(4, 4 + length)));
  return { header, pixels: answer.subarray(4 + length) };
}

const SIZE = [320, 240];
const CASES = [
  ['spot.ply', {}],
  ['spot.ply', { eye: '1.7,1.1,-2.3', target: '0.05,0.2,0', 'camera-up': '0,1,0', shader: 'phong', shadows: 'on', 'edge-aa': 'samples' }],
  ['spot.ply', { view: 'iso', shader: 'toon', 'edge-aa': 'on', ortho: 'on' }],
  ['spot.ply', { view: 'left', preset: 'quality', ground: 'shadow' }],
  ['spot.ply', { shader: 'matcap', matcap: 'builtin', background: '0.2,0.3,0.4' }],
  ['hill.txt', {}],
  ['hill.txt', { 'points-as': 'balls', light: 'studio', ground: 'shadow' }],
  ['hill.txt', { 'color-by': 'classification', view: 'top' }],
  ['hill.txt', { 'color-by': 'intensity', colormap: 'turbo', classes: '!2', crop: '0.5,0.5,-9,3,3,9' }],
  ['gaussians.ply', {}],
  ['gaussians.ply', { eye: '3,2,3', target: '0,0,0', sort: 'pixel' }],
];

function flagsOf(state) {
  return Object.entries(state).flatMap(([name, value]) => (value === 'on' && ['shadows', 'ortho'].includes(name) ? [`--${name}`] : [`--${name}=${value}`]));
}

try {
  surfel('convert', spot, '--splats', '20000', '-q', '-o', 'spot.ply');
  writeFileSync(join(folder, 'hill.txt'), hill(70));
  writeFileSync(join(folder, 'gaussians.ply'), gaussians());
  const modules = [['emulated', load(emulated)], ...(isFused() ? [['fused', load(fused)]] : [])];
  if (!isFused()) console.log('note: this node has no fused multiply-add for WebAssembly: only the emulated module is tested');
  for (const [name, module] of modules) {
    assert.equal(module.exports.fused_errors(200_000), 0, `${name}: every sum of products is rounded once`);
    console.log(`ok: ${name}: fused multiply-add is exact`);
  }
  const open = new Map();
  for (const [file, state] of CASES) {
    surfel('render', file, ...flagsOf(state), '--size', SIZE.join('x'), '--backend', 'cpu', '-q', '-f', '-o', 'native.png');
    const native = decoded(readFileSync(join(folder, 'native.png')));
    for (const [name, module] of modules) {
      if (open.get(name) !== file) {
        const welcome = module.open(readFileSync(join(folder, file)), file);
        assert.equal(welcome.do, 'welcome', JSON.stringify(welcome));
        assert.deepEqual(welcome.inputs, [file]);
        open.set(name, file);
      }
      const { pixels } = draw(module, state, SIZE);
      const differing = pixels.filter((x, i) => x !== native.pixels[i]).length;
      assert.equal(pixels.length, native.pixels.length);
      assert.ok(new Set(pixels).size > 20, 'the image shows something');
      assert.equal(differing, 0, `${name}: ${file} ${JSON.stringify(state)}: ${differing} bytes differ`);
      console.log(`ok: ${name}: ${file} ${JSON.stringify(state)}`);
    }
  }
  for (const [name, module] of modules) {
    module.open(readFileSync(join(folder, 'spot.ply')), 'spot.ply');
    const { header } = draw(module, {}, SIZE, true);
    assert.equal(header.type, 'image/x-rgba');
    const { picked } = module.answer({ do: 'pick', id: 2, state: {}, size: SIZE, at: [160, 120] });
    assert.ok(picked && picked.row >= 0 && picked.input === 'spot.ply', JSON.stringify(picked));
    const { text } = module.answer({ do: 'copy', as: 'command', state: { view: 'top' }, size: SIZE });
    assert.equal(text, 'surfel render spot.ply --view top --size 320x240 -o view.png');
    assert.equal(module.open(Buffer.from('no file of splats'), 'a.ply').do, 'welcome');
    const refusal = module.answer({ do: 'draw', id: 3, state: {}, size: SIZE });
    assert.equal(refusal.do, 'error', 'a broken file has a message');
    assert.equal(module.answer(7).do, 'error');
    console.log(`ok: ${name}: moving images, picks, commands, broken files`);
  }
  if (flags.includes('--time')) {
    const median = (times) => times.sort((a, b) => a - b)[times.length >> 1];
    const native = surfel('render', 'spot.ply', '--size', '512x512', '--backend', 'cpu', '--threads', '1', '--repeat', '41', '--stats', '-q', '-f', '-o', 'native.png').toString();
    console.log(native);
    for (const [name, module] of modules) {
      module.open(readFileSync(join(folder, 'spot.ply')), 'spot.ply');
      const times = [];
      for (let i = 0; i < 41; i += 1) {
        const start = performance.now();
        draw(module, {}, [512, 512]);
        times.push(performance.now() - start);
      }
      console.log(`${name}: median ${median(times).toFixed(2)} ms, least ${Math.min(...times).toFixed(2)} ms`);
    }
  }
  console.log('all passed');
} finally {
  rmSync(folder, { recursive: true, force: true });
}
