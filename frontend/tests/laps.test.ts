import { expect, it } from 'vitest';
import { askedBy, compared, lapSource, quickest, reparted } from '../src/store/laps';

const lap = (start_s: number, end_s: number, counts = true) => ({
  lap: { start_s, end_s, counts, is_partial: !counts, driver: '', note: '' },
});

it('the quickest lap is the shortest one that counts', () => {
  expect(quickest([lap(0, 30, false), lap(30, 92), lap(92, 150), lap(150, 210)])).toBe(2);
  expect(quickest([lap(0, 30, false), lap(30, 92, false)])).toBeNull();
  expect(quickest([])).toBeNull();
});

it('a lap that does not count is not compared unless somebody chooses it', () => {
  expect(compared([lap(0, 80), lap(80, 160), lap(160, 240), lap(240, 296, false)])).toEqual([1, 2]);
  expect(compared([lap(0, 80), lap(80, 136, false)])).toEqual([0]);
  expect(compared([lap(0, 56, false)])).toEqual([]);
});

it('parts of a lap are told for more and for fewer parts, place by place', () => {
  expect(reparted([1, 2], 4)).toEqual([1, 1, 2, 2]);
  expect(reparted([1, 2, 3, 4], 2)).toEqual([1, 3]);
  expect(reparted([], 4)).toEqual([]);
});

it.each([
  ['', ''],
  ['source=markers', 'source=markers'],
  ['source=nonsense', ''],
  ['source=can', 'source=can&can_id=784&can_byte=0'],
  ['source=can&can-id=0x123&can-byte=7', 'source=can&can_id=291&can_byte=7'],
  ['source=can&can-id=', null],
  ['source=can&can-id=0xZZ', null],
  ['source=can&can-byte=64', null],
  ['source=signal', null],
  ['source=signal&lap-signal=charger.flags', 'source=signal&lap_signal=charger.flags'],
  ['source=signal&lap-signal=a%26b', 'source=signal&lap_signal=a%26b'],
])('where laps come from stands in the address: %s asks for %s', (address, asked) => {
  expect(askedBy(lapSource(new URLSearchParams(address)))).toBe(asked);
});
