// The page of `surfel view`: plain DOM and one canvas. A source of images draws, and the page holds the state: an object
// of the program's options by name. The state lives in the address's fragment, and what is copied follows from it.
//
// There are three sources: the server of `surfel view` by a WebSocket, a WebAssembly module in an exported page
// (export.js), and a notebook's kernel (widget.js). They answer the same messages.
'use strict';

const $ = (id) => document.getElementById(id);
const make = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

// ---------------------------------------------------------------- vectors
const add = (a, b) => a.map((x, i) => x + b[i]);
const sub = (a, b) => a.map((x, i) => x - b[i]);
const scaled = (a, k) => a.map((x) => x * k);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => scaled(a, 1 / (length(a) || 1));
/** Rotates a vector about a unit axis (Rodrigues). */
const turned = (v, axis, angle) => {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(scaled(v, c), scaled(cross(axis, v), s)), scaled(axis, dot(axis, v) * (1 - c)));
};
/** Formats a vector. Ten digits are enough for map coordinates, and the same text gives the same image. */
const text = (v) => v.map((x) => Number(x.toPrecision(10))).join(',');
const short = (x) => (x === null ? '–' : Number(x.toPrecision(7)).toString());
/** Formats a coordinate with 11 digits. Map coordinates have seven of them before the decimal point. */
const coordinate = (x) => Number(x.toPrecision(11)).toString();

// ---------------------------------------------------------------- state
const VIEWS = ['auto', 'iso', 'front', 'back', 'left', 'right', 'top', 'bottom'];
const CAMERA = ['view', 'eye', 'target', 'camera-up', 'ortho-height'];
const UPS = ['+z', '+y', '-z', '-y', '+x', '-x'];
const COLOUR = ['color-by', 'colormap', 'range'];
const APPEARANCE = ['preset', 'shader', 'points-as', 'light', 'shadows', 'ground', 'style', 'edge-aa', 'filter',
  'background', 'transparency', 'depth-tolerance', 'radius-scale'];

let state = {};          // options of the image
let other = null;        // options that differ at the right side of a comparison
let leftFile = null;     // number of the file at the left side, if files are compared
let rows = new Map();    // the program's options by name
let welcome = null;      // first message of the server
let camera = null;       // camera of the newest image, or of the input after it
let scene = null;        // description of the scene
let picks = [];
let wholeBounds = null;  // bounds of the scene without a clip box

/** Returns the state that the address's fragment contains; null if it contains none. */
function fragment() {
  try {
    const found = JSON.parse(decodeURIComponent(location.hash.slice(1)));
    return found && typeof found === 'object' && !Array.isArray(found) ? found : null;
  } catch { return null; }
}

function writeFragment() {
  // The frame of a notebook has no address, so that this may fail.
  try { history.replaceState(null, '', '#' + encodeURIComponent(JSON.stringify(state))); } catch { /* nothing to keep */ }
}

/** Sets options of the state; the value undefined removes an option. If `still` is true, draws the exact image. */
function set(changes, still = true) {
  for (const [name, value] of Object.entries(changes)) {
    if (value === undefined || value === '') delete state[name]; else state[name] = value;
  }
  writeFragment();
  showControls();
  if (still) drawStill();
}

// ---------------------------------------------------------------- source of images
let lastId = 0;
let lastDrawn = 0; // id of the newest exact image that was asked for
const waiting = new Map(); // functions that get answers, by id
const stats = { latencies: [], frames: [], stills: [], server: [], first: null }; // measured by tests
window.surfelStats = stats;
/** True if the newest image is exact and nothing newer is wanted. */
window.surfelIsStill = () => !isMoving && stats.exact === lastDrawn;

/** Type of images whose file is their pixels: sRGB and alpha, a byte each. */
const PIXELS = 'image/x-rgba';

/** Splits a message into its header, whose length is in the first four bytes, and its file. */
function unpacked(bytes) {
  const size = new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + size)));
  const file = bytes.subarray(4 + size);
  return [header, header.type === PIXELS ? file : new Blob([file], { type: header.type })];
}

/** The server of `surfel view`. */
const server = {
  socket: null,
  start() {
    this.socket = new WebSocket(`ws://${location.host}/socket`);
    this.socket.binaryType = 'arraybuffer';
    this.socket.onmessage = ({ data }) => {
      if (typeof data === 'string') receive(JSON.parse(data), null); else receive(...unpacked(new Uint8Array(data)));
    };
    this.socket.onclose = async () => {
      lose('The server is gone.');
      const answer = await fetch('/', { cache: 'no-store' }).catch(() => null);
      if (answer && answer.status === 403) {
        return say('The server was started again: open the new address that it printed.', true);
      }
      say('The server is gone. Trying again…', true);
      setTimeout(() => this.start(), 700);
    };
  },
  /** Sends a message; false if that isn't possible. */
  send(message) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  },
};
const source = window.surfelSource ?? server;

/** Rejects all requests that wait for an answer, for the reason `why`. */
function lose(why) {
  movingIds.clear();
  waiting.forEach(({ reject }) => reject(new Error(why)));
  waiting.clear();
}

function send(message) {
  message.id = ++lastId;
  return source.send(message) ? message.id : 0;
}

/** Sends a request, and resolves with the answer's header and file. */
function ask(message) {
  return new Promise((resolve, reject) => {
    const id = send(message);
    if (id) waiting.set(id, { resolve, reject }); else reject(new Error('Nobody answers.'));
  });
}

function receive(header, file) {
  const answer = waiting.get(header.id);
  waiting.delete(header.id);
  switch (header.do) {
    case 'welcome': return begin(header);
    case 'progress': return say(`${header.stage}${header.part === null ? '…' : ` ${Math.round(100 * header.part)} %`}`);
    case 'image': return show(header, file);
    case 'error':
      if (header.of === 'draw') forgetAsked(header);
      if (answer) return answer.reject(new Error(header.message));
      return say(header.message, true);
    default: if (answer) answer.resolve({ header, file });
  }
}

function say(message, bad = false) {
  $('status').textContent = message;
  $('status').classList.toggle('bad', bad);
}

function begin(message) {
  // If another file was opened, everything about the previous one is removed.
  if (message.isOther) {
    [camera, scene, knownClasses, wholeBounds, picks] = [null, null, null, null, []];
    endComparing();
    showPicks();
    writeFragment();
  }
  welcome = message;
  rows = new Map(message.rows.map((row) => [row.name, row]));
  state = (message.isOther ? null : fragment()) ?? { ...message.state };
  $('title').textContent = `Surfel: ${message.inputs.join(', ')}`;
  document.title = `${message.inputs.join(', ')} – Surfel`;
  makeControls();
  drawStill();
}

// ---------------------------------------------------------------- drawing
const canvas = $('image');
const context = canvas.getContext('2d');
const layers = [null, null]; // newest image of each side: bitmap and header
const movingIds = new Set(); // requests for moving images of the first side that aren't answered
let isMoving = false;        // input since the last exact image
let wanted = null;           // time of input that no image was asked for yet
let stillTimer = 0;
let scale = 0.5;             // of moving images, adapted to the server's speed
const inputTimes = new Map();

function sizePx() {
  const box = $('stage').getBoundingClientRect();
  const ratio = window.devicePixelRatio || 1;
  return [Math.max(1, Math.round(box.width * ratio)), Math.max(1, Math.round(box.height * ratio))];
}

function sideStates() {
  if (!other) return [state];
  return [leftFile === null ? state : { ...state, input: leftFile }, { ...state, ...other }];
}

function drawStill() {
  clearTimeout(stillTimer);
  isMoving = false;
  wanted = null;
  const size = sizePx();
  sideStates().forEach((side, layer) => {
    const id = send({ do: 'draw', layer, state: side, size });
    if (id) inputTimes.set(id, performance.now());
    if (layer === 0) lastDrawn = id;
  });
}

/** Draws for input that moves the camera: at once if the server is free, else after its next image. */
function drawMoving(time = performance.now()) {
  isMoving = true;
  wanted ??= time;
  clearTimeout(stillTimer);
  stillTimer = setTimeout(() => { writeFragment(); drawStill(); }, 120);
  sendMoving();
}

/** Forgets the requests that an image or an error answers: its own, and the older ones that it replaced. */
function forgetAsked({ id, layer }) {
  if (layer === 1) return;
  movingIds.forEach((asked) => { if (asked <= id) movingIds.delete(asked); });
}

function sendMoving() {
  if (wanted === null || movingIds.size >= 2) return;
  const size = sizePx().map((side) => Math.max(16, Math.round(side * scale)));
  sideStates().forEach((side, layer) => {
    const id = send({ do: 'draw', layer, state: side, size, moving: true });
    if (!id) return;
    inputTimes.set(id, wanted);
    if (layer === 0) movingIds.add(id);
  });
  wanted = null;
}

async function show(header, file) {
  forgetAsked(header);
  // The scale is adapted so that drawing takes about 22 ms per image, which leaves time for encoding and sending.
  if (header.moving && header.layer === 0) {
    scale = Math.min(1, Math.max(0.25, scale * Math.sqrt(Math.min(1.6, Math.max(0.5, 22 / header.ms)))));
  }
  sendMoving();
  // An image that answers an older request doesn't replace a newer one.
  const isLate = () => layers[header.layer] && header.id < layers[header.layer].header.id;
  if (isLate()) return;
  const pixels = () => new ImageData(new Uint8ClampedArray(file.buffer, file.byteOffset, file.length), ...header.size);
  const bitmap = await createImageBitmap(header.type === PIXELS ? pixels() : file);
  if (isLate() || (header.layer === 1 && !other)) return bitmap.close();
  layers[header.layer]?.bitmap.close();
  layers[header.layer] = { bitmap, header };
  paint();
  const asked = inputTimes.get(header.id);
  for (const id of inputTimes.keys()) if (id <= header.id) inputTimes.delete(id);
  if (header.layer !== 0) {
    if (!header.moving && layers[0] && !layers[0].header.moving) sayDrawn(layers[0].header);
    return;
  }
  const now = performance.now();
  stats.first ??= now;
  if (asked !== undefined) (header.moving ? stats.latencies : stats.stills).push(now - asked);
  stats.frames.push(now);
  if (header.moving) {
    stats.server.push(header.ms);
  } else {
    settle(header);
    stats.file = file;
  }
  showMarks();
}

/** Stores the camera and scene that the header of an exact image states, and shows its notes. */
function settle(header) {
  stats.exact = header.id;
  if (!isMoving) camera = header.camera;
  const isNew = JSON.stringify(scene) !== JSON.stringify(header.scene);
  scene = header.scene;
  stats.camera = camera;
  if (isNew) { showScene(); showControls(); }
  if (header.notes.length) $('notes').replaceChildren(...header.notes.map((note) => make('li', {}, note)));
  sayDrawn(header);
  const [width, height] = header.size;
  if (!document.activeElement?.id.startsWith('save-')) [$('save-width').value, $('save-height').value] = [width, height];
}

/** Shows an exact image's size, numbers of splats, backend and drawing time in the status line. */
function sayDrawn({ size: [width, height], splats, drawn, frame_ms, backend }) {
  say(`${width}×${height}, ${splats.toLocaleString('en')} splats, ${drawn.toLocaleString('en')} drawn by ${backend} in ${frame_ms.toFixed(1)} ms`);
}

function paint() {
  const [width, height] = sizePx();
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  context.clearRect(0, 0, width, height);
  if (layers[0]) context.drawImage(layers[0].bitmap, 0, 0, width, height);
  if (other && layers[1]) {
    const x = Math.round(width * $('divider').value / 1000);
    context.save();
    context.beginPath();
    context.rect(x, 0, width - x, height);
    context.clip();
    context.clearRect(x, 0, width - x, height);
    context.drawImage(layers[1].bitmap, 0, 0, width, height);
    context.restore();
    context.fillStyle = '#888';
    context.fillRect(x - 1, 0, 2, height);
  }
}

new ResizeObserver(() => { paint(); if (welcome) { clearTimeout(stillTimer); stillTimer = setTimeout(drawStill, 150); } }).observe($('stage'));

// ---------------------------------------------------------------- camera
const isParallel = () => camera && 'orthographic' in camera.projection;

function axes() {
  const forward = unit(sub(camera.target, camera.eye));
  const right = unit(cross(forward, camera.up));
  return { forward, right, up: cross(right, forward) };
}

/** Returns the vertical field of view in radians. */
function fieldOfView() {
  const { perspective, intrinsics } = camera.projection;
  if (perspective) return perspective.fov_y_deg * Math.PI / 180;
  return 2 * Math.atan(camera.size[1] / 2 / intrinsics.fy);
}

/** Returns world units per CSS pixel at the target. */
function unitsPerPixel() {
  const height = $('stage').clientHeight || 1;
  if (isParallel()) return camera.projection.orthographic.height / height;
  return 2 * length(sub(camera.target, camera.eye)) * Math.tan(fieldOfView() / 2) / height;
}

/** Moves the camera, and draws. */
function place(eye, target, up, height) {
  Object.assign(camera, { eye, target, up });
  delete state.view;
  Object.assign(state, { eye: text(eye), target: text(target), 'camera-up': text(up) });
  if (height !== undefined) {
    camera.projection = { orthographic: { height } };
    Object.assign(state, { ortho: 'on', 'ortho-height': short(height) });
  } else if (isParallel() && !state['ortho-height']) {
    Object.assign(state, { ortho: 'on', 'ortho-height': short(camera.projection.orthographic.height) });
  } else if (camera.projection.intrinsics) {
    state['fov-y'] = short(fieldOfView() * 180 / Math.PI);
  }
  showMarks();
  drawMoving();
}

function upVector() {
  const up = scene?.up ?? '+y';
  return ['x', 'y', 'z'].map((axis) => (up[1] === axis ? (up[0] === '-' ? -1 : 1) : 0));
}

/** Turns the camera about its target: by `yaw` about the scene's up axis, and by `pitch` upward, in radians. */
function orbit(yaw, pitch) {
  if (!camera) return;
  const { right, up } = axes();
  const axis = upVector();
  const rotate = (v) => turned(turned(v, right, -pitch), axis, -yaw);
  const offset = rotate(sub(camera.eye, camera.target));
  // The camera doesn't turn past the up axis.
  const level = dot(unit(offset), axis);
  if (Math.abs(level) > 0.9998 && Math.abs(level) > Math.abs(dot(unit(sub(camera.eye, camera.target)), axis))) {
    return orbitLevel(yaw, axis);
  }
  const above = rotate(up);
  const upright = Math.abs(level) < 0.999 ? scaled(axis, dot(above, axis) < 0 ? -1 : 1) : above;
  place(add(camera.target, offset), camera.target, upright);
}

function orbitLevel(yaw, axis) {
  const rotate = (v) => turned(v, axis, -yaw);
  place(add(camera.target, rotate(sub(camera.eye, camera.target))), camera.target, rotate(camera.up));
}

/** Shifts the camera by CSS pixels. */
function pan(dx, dy) {
  if (!camera) return;
  const { right, up } = axes();
  const shift = add(scaled(right, -dx * unitsPerPixel()), scaled(up, dy * unitsPerPixel()));
  place(add(camera.eye, shift), add(camera.target, shift), camera.up);
}

/** Zooms by a factor toward a point of the stage in CSS pixels; by default toward its middle. */
function zoom(factor, x, y) {
  if (!camera) return;
  const stage = $('stage');
  const { right, up } = axes();
  const [px, py] = [(x ?? stage.clientWidth / 2) - stage.clientWidth / 2, (y ?? stage.clientHeight / 2) - stage.clientHeight / 2];
  const point = add(camera.target, add(scaled(right, px * unitsPerPixel()), scaled(up, -py * unitsPerPixel())));
  const toward = (p) => add(point, scaled(sub(p, point), factor));
  if (isParallel()) {
    const shift = sub(toward(camera.target), camera.target);
    place(add(camera.eye, shift), add(camera.target, shift), camera.up, camera.projection.orthographic.height * factor);
  } else {
    place(toward(camera.eye), toward(camera.target), camera.up);
  }
}

/** Moves the camera and its target along the camera's axes, in steps of 2 % of the distance between them. */
function flyBy(ahead, aside, upward) {
  if (!camera) return;
  const { forward, right, up } = axes();
  const step = length(sub(camera.target, camera.eye)) * 0.02;
  const shift = add(add(scaled(forward, ahead * step), scaled(right, aside * step)), scaled(up, upward * step));
  place(add(camera.eye, shift), add(camera.target, shift), camera.up);
}

/** Looks around: turns the target about the eye. */
function look(yaw, pitch) {
  if (!camera) return;
  const { right } = axes();
  const ahead = turned(turned(sub(camera.target, camera.eye), right, -pitch), upVector(), -yaw);
  if (Math.abs(dot(unit(ahead), upVector())) > 0.999) return;
  place(camera.eye, add(camera.eye, ahead), upVector());
}

/** Views the scene from a side by its name; without one, as at the start. */
function setView(name) {
  const changes = Object.fromEntries(CAMERA.map((key) => [key, undefined]));
  set({ ...changes, view: name });
}

function upright() {
  const at = UPS.indexOf(scene?.up ?? '+z');
  const up = UPS[(at + 1) % UPS.length];
  const changes = Object.fromEntries(CAMERA.map((key) => [key, undefined]));
  set({ ...changes, view: state.view ?? 'auto', up });
  say(`The up axis is ${up} now.`);
}

function toggleParallel() {
  const changes = Object.fromEntries(['fov-y', 'ortho-height'].map((key) => [key, undefined]));
  if (state.ortho === 'on') return set({ ...changes, ortho: undefined });
  // The camera of a scene file has a parallel projection of its own.
  if (isParallel()) return set({ ...changes, 'fov-y': '35' });
  const height = camera && unitsPerPixel() * $('stage').clientHeight;
  set({ ...changes, ortho: 'on', 'ortho-height': state.eye && height ? short(height) : undefined });
}

// ---------------------------------------------------------------- pointer and keys
const fingers = new Map();
let isFlying = false;
let travelled = 0;

canvas.addEventListener('pointerdown', (event) => {
  canvas.setPointerCapture(event.pointerId);
  canvas.focus();
  fingers.set(event.pointerId, event);
  if (fingers.size === 1) travelled = 0;
  event.preventDefault();
});
canvas.addEventListener('pointermove', (event) => {
  const before = fingers.get(event.pointerId);
  if (!before) return;
  const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
  travelled += Math.abs(dx) + Math.abs(dy);
  if (travelled < 4) return;
  if (fingers.size === 2) {
    const [a, b] = [...fingers.values()];
    const gap = (p, q) => Math.hypot(p.clientX - q.clientX, p.clientY - q.clientY) || 1;
    const still = a.pointerId === event.pointerId ? b : a;
    const box = canvas.getBoundingClientRect();
    zoom(gap(before, still) / gap(event, still), (event.clientX + still.clientX) / 2 - box.left, (event.clientY + still.clientY) / 2 - box.top);
    pan(dx / 2, dy / 2);
  } else if (isFlying) {
    look(dx * 0.004, dy * 0.004);
  } else if (before.buttons & 6 || event.shiftKey) {
    pan(dx, dy);
  } else {
    orbit(dx * 0.008, dy * 0.008);
  }
  fingers.set(event.pointerId, event);
});
for (const name of ['pointerup', 'pointercancel']) {
  canvas.addEventListener(name, (event) => {
    const known = fingers.delete(event.pointerId);
    if (name === 'pointerup' && known && travelled < 4 && event.button === 0 && !fingers.size) {
      const box = canvas.getBoundingClientRect();
      pick(event.clientX - box.left, event.clientY - box.top);
    }
  });
}
canvas.addEventListener('contextmenu', (event) => event.preventDefault());
canvas.addEventListener('wheel', (event) => {
  event.preventDefault();
  const box = canvas.getBoundingClientRect();
  const pixels = event.deltaY * (event.deltaMode === 1 ? 30 : 1);
  zoom(Math.exp(Math.max(-200, Math.min(200, pixels)) * 0.0015), event.clientX - box.left, event.clientY - box.top);
}, { passive: false });

/** Keys: what they do, and their help. Digits, Enter, S, A, B and H mean what they do in f3d. */
const KEYS = {
  ArrowLeft: [() => orbit(-0.09, 0), '← → ↑ ↓', 'turn (with Shift: move)'],
  ArrowRight: [() => orbit(0.09, 0)], ArrowUp: [() => orbit(0, -0.09)], ArrowDown: [() => orbit(0, 0.09)],
  '+': [() => zoom(0.9), '+ −', 'zoom'], '=': [() => zoom(0.9)], '-': [() => zoom(1 / 0.9)],
  1: [() => setView('front'), '1 3 7 9', 'front, right, top, iso'], 3: [() => setView('right')],
  7: [() => setView('top')], 9: [() => setView('iso')],
  5: [toggleParallel, '5', 'parallel or perspective'],
  Enter: [() => setView(), 'Enter', 'the view at the start'],
  s: [() => cycle('color-by', ['', ...colourNames()]), 'S', 'next colouring'],
  b: [() => { $('legend').classList.toggle('off'); showLegend(); }, 'B', 'legend on or off'],
  a: [() => cycle('edge-aa', ['', 'on', 'samples', 'off']), 'A', 'edge antialiasing'],
  q: [() => cycle('shader', ['', 'edl']), 'Q', 'eye-dome lighting'],
  u: [upright, 'U', 'other up axis'],
  f: [() => toggleFly(), 'F', 'fly: W A S D, R up, C down; Esc ends'],
  t: [() => toggleSpin(), 'T', 'turntable'],
  p: [() => pick($('stage').clientWidth / 2, $('stage').clientHeight / 2), 'P', 'pick the middle of the image'],
  h: [() => $('help').showModal(), 'H', 'this list'],
  Escape: [() => { if (isFlying) toggleFly(); stopSpin(); }, 'Esc', 'end flying and turning'],
};
const FLY = { w: [1, 0, 0], s: [-1, 0, 0], a: [0, -1, 0], d: [0, 1, 0], r: [0, 0, 1], c: [0, 0, -1] };
const SHIFTED = { ArrowLeft: [30, 0], ArrowRight: [-30, 0], ArrowUp: [0, 30], ArrowDown: [0, -30] };

document.addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const target = event.target;
  if (target !== canvas && target !== document.body) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (isFlying && FLY[key]) flyBy(...FLY[key]);
  else if (event.shiftKey && SHIFTED[key]) pan(...SHIFTED[key]);
  else if (Object.hasOwn(KEYS, key)) KEYS[key][0]();
  else return;
  event.preventDefault();
});

function cycle(name, values) {
  const at = values.indexOf(state[name] ?? '');
  const next = values[(at + 1) % values.length];
  set({ [name]: next || undefined });
  say(`${name}: ${next || 'default'}`);
}

function toggleFly() {
  isFlying = !isFlying;
  $('fly').setAttribute('aria-pressed', isFlying);
  canvas.focus();
}

let spinTimer = 0;
function stopSpin() {
  cancelAnimationFrame(spinTimer);
  spinTimer = 0;
  $('spin').setAttribute('aria-pressed', false);
}
function toggleSpin() {
  if (spinTimer) return stopSpin();
  $('spin').setAttribute('aria-pressed', true);
  let last = performance.now();
  const step = (now) => {
    spinTimer = requestAnimationFrame(step);
    // The next image is requested only when the server is free, so that the scene turns evenly.
    if (movingIds.size >= 2) return;
    orbit((now - last) * 0.0006, 0);
    last = now;
  };
  spinTimer = requestAnimationFrame(step);
}

// ---------------------------------------------------------------- picking
async function pick(x, y) {
  const ratio = window.devicePixelRatio || 1;
  const at = [Math.floor(x * ratio), Math.floor(y * ratio)];
  try {
    const { header } = await ask({ do: 'pick', state, size: sizePx(), at });
    if (!header.picked) return say('There is nothing at this point.');
    picks = [...picks, header.picked].slice(-2);
    stats.picked = header.picked;
    showPicks();
  } catch (error) { say(error.message, true); }
}

function showPicks() {
  const list = (entries) => make('dl', {}, ...entries.flatMap(([name, value]) => [make('dt', {}, name), make('dd', {}, value)]));
  const blocks = picks.map((picked, i) => {
    const entries = [[`Position ${'AB'[i]}`, picked.position.map(coordinate).join(', ')], ['Normal', picked.normal.map((x) => x.toFixed(3)).join(', ')]];
    if (picked.input) entries.push(['File', picked.input]);
    if (picked.row !== null) entries.push(['Row', String(picked.row)]);
    return list([...entries, ...Object.entries(picked.values).map(([name, value]) => [name, short(value)])]);
  });
  if (picks.length === 2) {
    const between = sub(picks[1].position, picks[0].position);
    blocks.push(list([['Distance A–B', short(length(between))], ['Along x, y, z', between.map(short).join(', ')]]));
  }
  $('picked').replaceChildren(...blocks);
  $('unpick').hidden = !picks.length;
  showMarks();
}

/** Places the marks of picks over the image. */
function showMarks() {
  if (!camera) return;
  const { forward, right, up } = axes();
  const stage = $('stage');
  const marks = picks.flatMap((picked, i) => {
    const offset = sub(picked.position, camera.eye);
    const depth = dot(offset, forward);
    if (depth <= 0) return [];
    const k = isParallel() ? 1 / unitsPerPixel() : stage.clientHeight / (2 * depth * Math.tan(fieldOfView() / 2));
    const mark = make('span', { className: 'mark' });
    mark.dataset.name = 'AB'[i];
    mark.style.left = `${stage.clientWidth / 2 + dot(offset, right) * k}px`;
    mark.style.top = `${stage.clientHeight / 2 - dot(offset, up) * k}px`;
    return [mark];
  });
  $('marks').replaceChildren(...marks);
}

// ---------------------------------------------------------------- controls
const controls = new Map(); // control of each option, with a function that shows a value

const NAMES = { 'edge-aa': 'Edge antialiasing', colormap: 'Colour map', 'lod-error': 'Level of detail (pixels)', cull: 'Culling' };
const label = (name) => NAMES[name] ?? (name[0].toUpperCase() + name.slice(1)).replaceAll('-', ' ').replace('olor', 'olour');

/** Makes the control of an option. `change` gets the new value, or undefined for the default. */
function control(row, change) {
  const help = { title: row.help };
  if (row.switch) {
    const box = make('input', { type: 'checkbox', ...help });
    box.onchange = () => change(box.checked ? 'on' : undefined);
    return { element: make('label', help, box, label(row.name)), show: (value) => { box.checked = value === 'on'; } };
  }
  if (row.names && !row.open && !row.value.includes(',')) {
    const select = make('select', help, make('option', { value: '' }, row.default ? `default (${row.default})` : 'default'));
    select.append(...row.names.map((name) => make('option', { value: name }, name)));
    select.onchange = () => change(select.value || undefined);
    return { element: make('label', help, `${label(row.name)} `, select), show: (value) => { select.value = value ?? ''; } };
  }
  const input = make('input', { placeholder: row.value.replace('|shared', ''), spellcheck: false, ...help });
  input.onchange = () => change(input.value.trim() || undefined);
  return { element: make('label', help, `${label(row.name)} `, input), show: (value) => { input.value = [value ?? ''].flat().join(' and '); } };
}

function put(parent, name) {
  const row = rows.get(name);
  if (!row) return;
  const made = control(row, (value) => set({ [name]: value }));
  controls.set(name, made);
  parent.append(made.element);
}

function makeControls() {
  controls.clear();
  for (const id of ['colour', 'appearance', 'everything', 'clip', 'views']) $(id).replaceChildren();
  $('views').append(...VIEWS.map((name) => {
    const button = make('button', { type: 'button' }, name === 'auto' ? 'Best' : label(name));
    button.dataset.view = name;
    button.onclick = () => setView(name);
    return button;
  }));
  COLOUR.forEach((name) => put($('colour'), name));
  makeColourSelect();
  APPEARANCE.forEach((name) => put($('appearance'), name));
  makeClip();
  for (const row of rows.values()) {
    if (!controls.has(row.name) && ![...CAMERA, 'ortho', 'crop', 'classes'].includes(row.name)) put($('everything'), row.name);
  }
  const choices = [...rows.values()].filter((row) => row.switch || row.names || COLOUR.includes(row.name));
  $('other-name').replaceChildren(make('option', { value: '' }, 'choose…'), ...choices.map((row) => make('option', { value: row.name }, row.name)));
  if (welcome.inputs.length > 1) $('other-name').append(make('option', { value: 'input' }, 'input file'));
  $('keys').replaceChildren(...Object.values(KEYS).filter(([, keys]) => keys).map(([, keys, help]) => make('tr', {}, make('th', { scope: 'row' }, keys), make('td', {}, help))));
  showKept();
  showControls();
}

const colourNames = () => [...(scene?.gaussians ? [] : ['height', 'normal', 'rgb']), ...Object.keys(scene?.columns ?? {})];

/** Replaces the text field of `color-by` by a list of the scene's attributes. */
function makeColourSelect() {
  const old = controls.get('color-by');
  if (!old) return;
  const select = make('select', { title: rows.get('color-by').help });
  select.onchange = () => set({ 'color-by': select.value || undefined, colormap: undefined, range: undefined });
  const element = make('label', {}, 'Colour by ', select);
  const show = (value) => {
    const names = [...new Set([...colourNames(), ...(value ? [value] : [])])];
    select.replaceChildren(make('option', { value: '' }, 'the file’s colours'), ...names.map((name) => make('option', { value: name }, name)));
    select.value = value ?? '';
  };
  old.element.replaceWith(element);
  controls.set('color-by', { element, show });
}

/** Makes the six sides of the clip box, and the slider of a section. */
function makeClip() {
  const sides = ['least', 'greatest'].flatMap((side) => ['x', 'y', 'z'].map((axis) => `${label(side)} ${axis}`));
  const inputs = sides.map((name) => make('input', { type: 'number', step: 'any', name }));
  // Bounds of the whole scene, also while a part is shown.
  const whole = () => {
    if (scene?.bounds && !state.crop) wholeBounds = scene.bounds.flat();
    return [...(wholeBounds ?? scene?.bounds?.flat() ?? [0, 0, 0, 1, 1, 1])];
  };
  const apply = () => {
    const box = inputs.map((input, i) => (input.value === '' ? whole()[i] : Number(input.value)));
    set({ crop: inputs.every((input) => input.value === '') ? undefined : text(box) });
  };
  inputs.forEach((input) => { input.onchange = apply; });
  const axis = make('select', {}, make('option', { value: '' }, 'none'), ...['x', 'y', 'z'].map((name, i) => make('option', { value: i }, name)));
  const slider = make('input', { type: 'range', min: 0, max: 1000, value: 500 });
  const section = () => {
    if (axis.value === '') return set({ crop: undefined });
    const box = whole();
    const i = Number(axis.value);
    box[i] += (box[i + 3] - box[i]) * slider.value / 1000;
    set({ crop: text(box) });
  };
  axis.onchange = section;
  slider.onchange = section;
  const row = (from) => make('div', { className: 'row' }, ...inputs.slice(from, from + 3).map((input, i) => make('label', {}, `${sides[from + i]} `, input)));
  const clear = make('button', { type: 'button' }, 'No clip');
  clear.onclick = () => { axis.value = ''; set({ crop: undefined }); };
  $('clip').append(row(0), row(3), make('label', {}, 'Section along ', axis), make('label', {}, 'Place of the section ', slider), make('div', { className: 'buttons' }, clear));
  controls.set('crop', {
    show: (value) => {
      const box = value ? value.split(',') : [];
      inputs.forEach((input, i) => { input.value = box[i] ?? ''; input.placeholder = short(whole()[i]); });
    },
  });
}

/** Shows the state in all controls. */
function showControls() {
  for (const [name, made] of controls) made.show(state[name]);
  for (const button of document.querySelectorAll('[data-view]')) {
    button.setAttribute('aria-pressed', !state.eye && (state.view ?? 'auto') === button.dataset.view);
  }
  $('parallel').setAttribute('aria-pressed', state.ortho === 'on' || Boolean(isParallel()));
  showClasses();
}

function hiddenClasses() {
  return new Set((state.classes ?? '').startsWith('!') ? state.classes.slice(1).split(',').map(Number) : []);
}

let knownClasses = null; // classes of the whole file: those that are hidden aren't loaded
function showClasses() {
  if (scene?.classes && !state.classes) knownClasses = scene.classes;
  const known = knownClasses ?? scene?.classes ?? [];
  const hidden = hiddenClasses();
  const others = [...hidden].filter((number) => known.every((entry) => entry.class !== number));
  const all = [...known, ...others.map((number) => ({ class: number, name: '', count: null }))].sort((a, b) => a.class - b.class);
  const boxes = all.map(({ class: number, name, count }) => {
    const box = make('input', { type: 'checkbox', checked: !hidden.has(number) });
    box.onchange = () => {
      const now = hiddenClasses();
      if (box.checked) now.delete(number); else now.add(number);
      set({ classes: now.size ? `!${[...now].join(',')}` : undefined });
    };
    return make('label', {}, box, `${number} ${name} (${count === null ? 'hidden' : count.toLocaleString('en')})`);
  });
  const focused = [...$('classes').querySelectorAll('input')].indexOf(document.activeElement);
  $('classes').replaceChildren($('classes').firstElementChild, ...boxes);
  if (focused >= 0) $('classes').querySelectorAll('input')[focused]?.focus();
  $('classes').hidden = !all.length;
}

function showScene() {
  showLegend();
  // Trained Gaussians have no surface to shade.
  for (const name of ['shader', 'light', 'ground', 'bounce', 'shadows', 'edge-aa']) {
    const element = controls.get(name)?.element;
    if (element) element.hidden = Boolean(scene?.gaussians);
  }
}

function showLegend() {
  const legend = scene?.legend;
  const box = $('legend');
  box.hidden = !legend || box.classList.contains('off');
  if (!legend) return;
  box.setAttribute('aria-label', `Legend of ${legend.attribute}`);
  const title = make('strong', {}, legend.attribute);
  if (legend.categories) {
    const entries = legend.categories.slice(0, 40).map(({ value, name, color }) => {
      const chip = make('span', { className: 'chip' });
      chip.style.background = color;
      return make('div', {}, chip, name ? `${value} ${name}` : short(value));
    });
    return box.replaceChildren(title, ...entries);
  }
  const ramp = make('div', { className: 'ramp' });
  ramp.style.background = `linear-gradient(to right, ${legend.colors.join(', ')})`;
  box.replaceChildren(title, ramp, make('div', { className: 'ends' }, ...legend.range.map((x) => make('span', {}, short(x)))));
}

// ---------------------------------------------------------------- comparing
$('other-name').onchange = () => {
  const name = $('other-name').value;
  $('other-value').replaceChildren();
  if (!name) return endComparing();
  leftFile = null;
  const change = (value) => {
    other = { [name]: value };
    for (const id of ['measure', 'uncompare']) $(id).disabled = false;
    $('divider').hidden = false;
    $('measured').replaceChildren();
    drawStill();
  };
  if (name === 'input') {
    const files = (side, number) => {
      const select = make('select', {}, ...welcome.inputs.map((input, i) => make('option', { value: i }, input)));
      select.value = number;
      $('other-value').append(make('label', {}, `File at the ${side} `, select));
      return select;
    };
    const [left, right] = [files('left', 0), files('right', 1)];
    // Both sides are viewed by the same camera, not by the automatic camera of each.
    if (camera && !state.eye) place(camera.eye, camera.target, camera.up, camera.projection.orthographic?.height);
    left.onchange = right.onchange = () => {
      leftFile = Number(left.value);
      change(Number(right.value));
    };
    return left.onchange();
  }
  const made = control(rows.get(name), (value) => change(value ?? (rows.get(name).switch ? 'off' : undefined)));
  $('other-value').append(made.element);
};

function endComparing() {
  other = null;
  leftFile = null;
  layers[1]?.bitmap.close();
  layers[1] = null;
  $('divider').hidden = true;
  $('other-name').value = '';
  $('other-value').replaceChildren();
  $('measured').replaceChildren();
  for (const id of ['measure', 'uncompare']) $(id).disabled = true;
  paint();
}
$('uncompare').onclick = endComparing;
$('divider').oninput = paint;
$('measure').onclick = async () => {
  try {
    const [a, b] = sideStates();
    const { header, file } = await ask({ do: 'compare', a, b, size: sizePx() });
    const entries = [['Left', `${header.frame_ms[0].toFixed(1)} ms`], ['Right', `${header.frame_ms[1].toFixed(1)} ms`],
      ['Largest difference', short(header.max_abs)], ['RMSE', short(header.rmse)],
      ['PSNR', header.psnr === null ? 'equal' : `${header.psnr.toFixed(2)} dB`], ['FLIP', header.flip === null ? '–' : header.flip.toFixed(5)]];
    stats.compared = header;
    const list = make('dl', {}, ...entries.flatMap(([name, value]) => [make('dt', {}, name), make('dd', {}, value)]));
    const image = make('img', { alt: 'Map of the difference by FLIP', src: URL.createObjectURL(file) });
    $('measured').replaceChildren(list, image);
  } catch (error) { say(error.message, true); }
};

// ---------------------------------------------------------------- copying and saving
async function copied(text) {
  $('copied').hidden = false;
  $('copied').value = text;
  $('copied').select();
  await navigator.clipboard?.writeText(text).then(() => say('Copied.'), () => say('The text is below: copy it from there.'));
}
for (const button of document.querySelectorAll('[data-copy]')) {
  button.onclick = async () => {
    try {
      const { header } = await ask({ do: 'copy', as: button.dataset.copy, state, size: sizePx() });
      await copied(header.text);
    } catch (error) { say(error.message, true); }
  };
}

/** Copies the cameras of all kept views as the keys of a camera path, for `surfel render --path`. */
$('copy-path').onclick = async () => {
  try {
    const keys = [];
    for (const { name, state: saved } of kept()) {
      const { header } = await ask({ do: 'copy', as: 'scene', state: saved, size: sizePx() });
      keys.push({ name, camera: JSON.parse(header.text).camera });
    }
    drawStill();
    await copied(`${JSON.stringify({ keys }, null, 2)}\n`);
  } catch (error) { say(error.message, true); }
};

$('save').onclick = async () => {
  try {
    say('Drawing the image…');
    const size = [Number($('save-width').value), Number($('save-height').value)];
    const { file } = await ask({ do: 'save', state, size });
    const link = make('a', { href: URL.createObjectURL(file), download: `${welcome.inputs[0].replace(/\.[^.]*$/, '')}.png` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
    say(`Saved ${size[0]}×${size[1]} pixels.`);
  } catch (error) { say(error.message, true); }
};

const keptKey = () => `surfel-views ${welcome.inputs.join(' ')}`;
function kept() {
  try { return JSON.parse(localStorage.getItem(keptKey())) ?? []; } catch { return []; }
}
function writeKept(views) {
  try { localStorage.setItem(keptKey(), JSON.stringify(views)); } catch { say('The browser keeps no views here.', true); }
  showKept();
}
function showKept() {
  $('copy-path').hidden = kept().length < 2;
  $('kept').replaceChildren(...kept().map(({ name, state: saved }, i) => {
    const go = make('button', { type: 'button' }, name);
    go.onclick = () => { state = { ...saved }; writeFragment(); showControls(); drawStill(); };
    const drop = make('button', { type: 'button' }, 'Remove');
    drop.setAttribute('aria-label', `Remove ${name}`);
    drop.onclick = () => writeKept(kept().filter((_, j) => j !== i));
    return make('li', {}, go, drop);
  }));
}
$('keep').onsubmit = (event) => {
  event.preventDefault();
  const name = $('keep-name').value.trim();
  if (name) writeKept([...kept().filter((view) => view.name !== name), { name, state: { ...state } }]);
};

// ---------------------------------------------------------------- start
$('upright').onclick = upright;
$('parallel').onclick = toggleParallel;
$('fly').onclick = toggleFly;
$('spin').onclick = toggleSpin;
$('unpick').onclick = () => { picks = []; showPicks(); };
$('toggle').onclick = () => {
  const open = $('panels').hidden;
  $('panels').hidden = !open;
  $('toggle').setAttribute('aria-expanded', open);
};
window.addEventListener('hashchange', () => { const found = fragment(); if (found) { state = found; showControls(); drawStill(); } });
if (matchMedia('(max-width: 700px)').matches) $('toggle').click();
source.start({ receive, unpacked, lose, say });
