// The WebAssembly module of an exported page: the CPU backend, and what the server of `surfel view` answers. See
// crates/surfel-web. This file is used by the page's worker and by the module's test.
'use strict';

/** Numbers of the module's input buffers: for a file's bytes, and for a request's text. */
const [MODEL, REQUEST] = [0, 1];

/**
 * A module of one function, f32x4.relaxed_madd of three numbers. It shows whether the host has this instruction, and
 * whether the instruction rounds once (fused) or twice.
 */
const PROBE = new Uint8Array([
  0, 0x61, 0x73, 0x6d, 1, 0, 0, 0, // magic number and version
  1, 8, 1, 0x60, 3, 0x7d, 0x7d, 0x7d, 1, 0x7d, // a type: three f32 to one
  3, 2, 1, 0, // a function of this type
  7, 5, 1, 1, 0x66, 0, 0, // exported as "f"
  10, 0x16, 1, 0x14, 0, // code: the arguments in all lanes, multiply-add, the first lane
  0x20, 0, 0xfd, 0x13, 0x20, 1, 0xfd, 0x13, 0x20, 2, 0xfd, 0x13, 0xfd, 0x85, 2, 0xfd, 0x1f, 0, 0x0b,
]);

/** True if this host multiplies and adds with a single rounding, so that the faster module has the exact bits. */
function isFused() {
  if (!WebAssembly.validate(PROBE)) return false;
  const { f } = new WebAssembly.Instance(new WebAssembly.Module(PROBE)).exports;
  // (1 + 2⁻¹²)² = 1 + 2⁻¹¹ + 2⁻²⁴, whose last term is lost if the product is rounded.
  const factor = 1 + 2 ** -12;
  return f(factor, factor, -(1 + 2 ** -11)) === 2 ** -24;
}

/** A loaded drawing module, with functions that copy its inputs and outputs. */
class SurfelModule {
  constructor(compiled) {
    this.readFile = null; // returns bytes of the host's file, by offset and count
    const read = (at, address, count) => {
      try {
        new Uint8Array(this.exports.memory.buffer, address, count).set(this.readFile(at, count));
        return 0;
      } catch {
        return 1;
      }
    };
    this.exports = new WebAssembly.Instance(compiled, { host: { read } }).exports;
  }

  /** Copies bytes to a buffer of the module. */
  write(buffer, bytes) {
    const { make_room: makeRoom, memory } = this.exports;
    const address = makeRoom(buffer, bytes.length);
    if (!address && bytes.length) throw new Error('There is too little memory for this file.');
    new Uint8Array(memory.buffer).set(bytes, address);
  }

  /** Returns the reply: an object parsed from JSON, or bytes that contain a header and a file. */
  reply(length) {
    const { reply, memory } = this.exports;
    const bytes = new Uint8Array(memory.buffer, reply(), length).slice();
    return bytes[0] ? bytes.subarray(1) : JSON.parse(new TextDecoder().decode(bytes.subarray(1)));
  }

  /** Opens a file's bytes. `flags` are names and texts of options. Returns the first message. */
  open(bytes, name, flags = []) {
    this.write(MODEL, bytes);
    this.write(REQUEST, new TextEncoder().encode([name, ...flags.flat()].join('\n')));
    return this.reply(this.exports.open());
  }

  /** Opens a file of `bytes` bytes like open(); `readFile` returns parts of it, by byte offset and count. */
  openHost(readFile, bytes, name, flags = []) {
    this.readFile = readFile;
    this.write(REQUEST, new TextEncoder().encode([name, ...flags.flat()].join('\n')));
    return this.reply(this.exports.open_host(bytes));
  }

  /** Answers a request of the page. */
  answer(request) {
    this.write(REQUEST, new TextEncoder().encode(JSON.stringify(request)));
    return this.reply(this.exports.answer());
  }
}
