import { expect, it } from 'vitest';
import { fits, samplesText, spans, takenOf, toggled, withUnits } from '../src/store/importing';
import type { ImportMapping } from '../src/link/types';

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
  const mine = { time_unit: 's', voltage_unit: 'V', current: 'I' } as ImportMapping;
  const found = { time_unit: 'ms', voltage_unit: 'mV', current: 'I' } as ImportMapping;
  expect(withUnits(mine, found, ['voltage'])).toEqual({ ...mine, voltage_unit: 'mV' });
});

it('samples are as long as they tell something, and what is missing is a dash', () => {
  expect(samplesText({ samples: [3.70123456, null, -78.2, 1780000000123] })).toBe(
    '3.70123 · – · −78.2 · 1780000000123',
  );
});

it('a name stands for one column, a number for the one in its place, a pattern for many', () => {
  const columns = ['t', 'C1 (V)', 'C2 (V)', 'P1_C2'].map((name) => ({ name, samples: [] }));
  const names = (named: string): string[] => fits(named, columns).map((each) => each.name);
  expect(names('t')).toEqual(['t']);
  expect(names('2')).toEqual(['C1 (V)']);
  expect(names('C{n} (V)')).toEqual(['C1 (V)', 'C2 (V)']);
  expect(names('P{p}_C{n}')).toEqual(['P1_C2']);
  expect([names('0'), names('9'), names('C'), names('')]).toEqual([[], [], [], []]);
});
