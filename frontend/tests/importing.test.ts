import { expect, it } from 'vitest';
import { samplesText, spans, takenOf, toggled, withUnits } from '../src/store/importing';
import type { ImportProfile } from '../src/link/types';

it('cells are told as numbers from one and spans, and as nothing where all are taken', () => {
  expect(spans([true, true, true])).toBe('');
  expect(spans([true, true, false, true])).toBe('1-2, 4');
  expect(spans([false, true, true, true])).toBe('2-4');
  expect(spans([])).toBe('');
});

it('a text of cells is read as it is written, and one that cannot be read leaves none out', () => {
  const taken = [true, true, false, true];
  expect(takenOf(spans(taken), 4)).toEqual(taken);
  expect(takenOf(' 1 - 2,4', 4)).toEqual(taken);
  expect(takenOf('', 2)).toEqual([true, true]);
  expect(takenOf('1-', 2)).toEqual([true, true]);
});

it('a cell is left out and taken again, and one always stays', () => {
  expect(toggled([true, true], 0)).toEqual([false, true]);
  expect(toggled([false, true], 0)).toEqual([true, true]);
  expect(toggled([false, true], 1)).toEqual([false, true]);
});

it('only the units that were asked for are taken over', () => {
  const mine = { time_unit: 's', voltage_unit: 'V', current: 'I' } as ImportProfile;
  const found = { time_unit: 'ms', voltage_unit: 'mV', current: 'I' } as ImportProfile;
  expect(withUnits(mine, found, ['voltage'])).toEqual({ ...mine, voltage_unit: 'mV' });
});

it('samples are as long as they tell something, and what is missing is a dash', () => {
  expect(samplesText({ samples: [3.7012, null, 3700.4, 12] })).toBe('3.701 · – · 3700 · 12');
});
