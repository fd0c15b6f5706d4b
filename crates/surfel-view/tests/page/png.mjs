// Decoder of the PNG files that surfel writes.
import assert from 'node:assert/strict';
import { inflateSync } from 'node:zlib';

/** Returns width, height and pixels (RGBA) of a PNG with 8 bits per channel. */
export function decoded(png) {
  const chunks = [];
  let [width, height, channels] = [0, 0, 0];
  for (let at = 8; at < png.length;) {
    const [size, kind] = [png.readUInt32BE(at), png.toString('latin1', at + 4, at + 8)];
    const data = png.subarray(at + 8, at + 8 + size);
    if (kind === 'IHDR') {
      [width, height, channels] = [data.readUInt32BE(0), data.readUInt32BE(4), { 2: 3, 6: 4 }[data[9]]];
      assert.ok(data[8] === 8 && channels && data[12] === 0, 'an 8-bit image');
    }
    if (kind === 'IDAT') chunks.push(data);
    at += size + 12;
  }
  const rows = inflateSync(Buffer.concat(chunks));
  const pixels = new Uint8Array(width * height * 4).fill(255);
  const stride = width * channels;
  const last = new Uint8Array(stride);
  for (let y = 0; y < height; y += 1) {
    const filter = rows[y * (stride + 1)];
    const row = rows.subarray(y * (stride + 1) + 1, (y + 1) * (stride + 1));
    for (let x = 0; x < stride; x += 1) {
      const [left, up, corner] = [x >= channels ? row[x - channels] : 0, last[x], x >= channels ? last[x - channels] : 0];
      const guess = left + up - corner;
      const [a, b, c] = [Math.abs(guess - left), Math.abs(guess - up), Math.abs(guess - corner)];
      const paeth = a <= b && a <= c ? left : b <= c ? up : corner;
      const add = [0, left, up, (left + up) >> 1, paeth][filter];
      if (x >= channels) last[x - channels] = row[x - channels];
      row[x] = (row[x] + add) & 255;
    }
    last.set(row);
    for (let x = 0; x < width; x += 1) for (let k = 0; k < channels; k += 1) pixels[(y * width + x) * 4 + k] = row[x * channels + k];
  }
  return { width, height, pixels };
}
