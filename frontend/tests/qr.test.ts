// The QR code of an address: the symbol's size, its quiet zone, and its three finder patterns.

import { render } from 'svelte/server';
import { describe, expect, it } from 'vitest';
import type { System } from '../src/link/types';
import Reach from '../src/views/system/Reach.svelte';

const QUIET = 4;

/** The dark modules of the code of an address: of one host, on the port of the page. */
function modules(text: string): { size: number; dark: Set<string> } {
  const { protocol, hostname, port } = new URL(text);
  Object.assign(globalThis, { location: { protocol, port, hash: '' } });
  const system = { addresses: [hostname] } as System;
  const { body } = render(Reach, { props: { system } });
  const size = Number(/viewBox="0 0 (\d+) /.exec(body)?.[1]);
  return { size, dark: new Set([...body.matchAll(/M(\d+ \d+)h1v1h-1z/g)].map((found) => found[1]!)) };
}

describe('qr code', () => {
  it('has a quiet zone of four modules around a symbol that grows with its text', () => {
    expect(modules('http://a/').size).toBe(21 + 2 * QUIET);
    const { size, dark } = modules('http://192.168.1.20:8000/');
    expect(size).toBe(25 + 2 * QUIET);
    const places = [...dark].map((place) => place.split(' ').map(Number));
    expect(Math.min(...places.flat())).toBe(QUIET);
    expect(Math.max(...places.flat())).toBe(size - QUIET - 1);
  });

  it('has a finder pattern in three corners', () => {
    const { size, dark } = modules('http://192.168.1.20:8000/');
    for (const [x, y] of [
      [QUIET, QUIET],
      [size - QUIET - 7, QUIET],
      [QUIET, size - QUIET - 7],
    ] as const) {
      for (let i = 0; i < 7; i++) expect(dark.has(`${x + i} ${y}`)).toBe(true);
      expect(dark.has(`${x + 1} ${y + 1}`)).toBe(false);
      expect(dark.has(`${x + 3} ${y + 3}`)).toBe(true);
    }
  });
});
