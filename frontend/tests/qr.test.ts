// A QR code is read back here by the standard's rules: format, mask, block order, and a check that finds every error.

import { describe, expect, it } from 'vitest';
import { dataOrder, formatBits, multiply, qrCode } from '../src/store/qr';

const BLOCKS: Record<number, [blocks: number, data: number, ec: number, align: number]> = {
  21: [1, 16, 10, 0],
  25: [1, 28, 16, 18],
  29: [1, 44, 26, 22],
  33: [2, 32, 18, 26],
  37: [2, 43, 24, 30],
  41: [4, 27, 16, 34],
};

function isFunction(x: number, y: number, size: number, align: number): boolean {
  const corner = (x < 9 && y < 9) || (x > size - 9 && y < 9) || (x < 9 && y > size - 9);
  return corner || x === 6 || y === 6 || (align > 0 && Math.abs(x - align) < 3 && Math.abs(y - align) < 3);
}

const FLIPS = [
  (x: number, y: number) => (x + y) % 2,
  (_: number, y: number) => y % 2,
  (x: number) => x % 3,
  (x: number, y: number) => (x + y) % 3,
  (x: number, y: number) => (Math.floor(x / 3) + Math.floor(y / 2)) % 2,
  (x: number, y: number) => ((x * y) % 2) + ((x * y) % 3),
  (x: number, y: number) => (((x * y) % 2) + ((x * y) % 3)) % 2,
  (x: number, y: number) => (((x + y) % 2) + ((x * y) % 3)) % 2,
];

function read(code: boolean[][]): { text: string; syndromes: number[] } {
  const size = code.length;
  const [blocks, data, ec, align] = BLOCKS[size]!;
  let format = 0;
  for (let i = 0; i < 8; i++) format |= Number(code[8]![size - 1 - i]) << i;
  for (let i = 8; i < 15; i++) format |= Number(code[size - 15 + i]![8]) << i;
  const mask = FLIPS.findIndex((_, i) => formatBits(i) === format);
  expect(mask).toBeGreaterThanOrEqual(0);
  const bits: number[] = [];
  for (const [x, y] of dataOrder(size)) {
    if (!isFunction(x, y, size, align)) bits.push(Number(code[y]![x]! !== (FLIPS[mask]!(x, y) === 0)));
  }
  const words = Array.from({ length: blocks * (data + ec) }, (_, i) =>
    bits.slice(8 * i, 8 * i + 8).reduce((a, b) => 2 * a + b, 0),
  );
  const parts = Array.from({ length: blocks }, (_, b) =>
    Array.from({ length: data + ec }, (_, i) => words[i * blocks + b]!),
  );
  const syndromes = parts.flatMap((part) =>
    Array.from({ length: ec }, (_, k) => {
      let root = 1;
      for (let i = 0; i < k; i++) root = multiply(root, 2);
      return part.reduce((sum, word) => multiply(sum, root) ^ word, 0);
    }),
  );
  const stream = parts.flatMap((part) => part.slice(0, data));
  const length = ((stream[0]! & 15) << 4) | (stream[1]! >> 4);
  const bytes = Array.from({ length }, (_, i) => ((stream[i + 1]! & 15) << 4) | (stream[i + 2]! >> 4));
  return { text: new TextDecoder().decode(new Uint8Array(bytes)), syndromes };
}

describe('qr code', () => {
  it.each([14, 26, 42, 62, 84, 106])('of %i bytes is read back without an error', (length) => {
    const text = 'http://192.168.1.20:8000/#/overview?'.padEnd(length, 'x').slice(0, length);
    const result = read(qrCode(text)!);
    expect(result.text).toBe(text);
    expect(result.syndromes.every((s) => s === 0)).toBe(true);
  });

  it('grows with its text and refuses what does not fit', () => {
    expect(qrCode('x'.repeat(14))!.length).toBe(21);
    expect(qrCode('x'.repeat(15))!.length).toBe(25);
    expect(qrCode('x'.repeat(107))).toBeNull();
  });
});
