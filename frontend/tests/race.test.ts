import { describe, expect, it } from 'vitest';
import type { EnergyTarget } from '../src/link/types';
import { frameOf, type FrameDraft } from '../src/store/can';
import { compared, within } from '../src/store/prediction';

const target = (part: Partial<EnergyTarget>): EnergyTarget => ({
  laps_to_go: 12,
  reserve_soc: 0.05,
  lap_energy_wh: 300,
  low_wh: 285,
  high_wh: 315,
  used_wh: 0,
  expected_wh: null,
  last_lap_wh: null,
  counted_by: null,
  ...part,
});

describe('a lap against its target', () => {
  it('is this lap once enough of it is usual', () => {
    expect(compared(target({ used_wh: 110, expected_wh: 100, last_lap_wh: 300 }))).toEqual({
      text: '+10 %',
      isThis: true,
      state: 'over',
    });
  });

  it('is the last lap before that', () => {
    const early = compared(target({ used_wh: 4, expected_wh: 3, last_lap_wh: 285 }));
    expect(early).toEqual({ text: '\u22125 %', isThis: false, state: 'within' });
  });

  it('is nothing where nothing is known, or no lap is to go', () => {
    expect(compared(target({}))).toBeNull();
    expect(compared(target({ lap_energy_wh: null, last_lap_wh: 285 }))).toBeNull();
  });
});

describe('what is typed', () => {
  it('is a number within its limits or nothing', () => {
    expect(within(' 22 ', 1, 500)).toBe(22);
    expect(within('2,5', 0, 50)).toBe(2.5);
    for (const text of ['', '0', '501', 'x']) expect(within(text, 1, 500)).toBeNull();
  });
});

describe('a frame for the driver', () => {
  const draft: FrameDraft = { on: true, id: '0x6a0', extended: false, start: '2', big: true, period: '200' };

  it('is read as it was typed', () => {
    expect(frameOf(draft, 2)).toEqual({
      id: 0x6a0,
      extended: false,
      length: 8,
      start_byte: 2,
      byte_order: 'big',
      period_ms: 200,
    });
    expect(frameOf({ ...draft, on: false }, 2)).toBeNull();
  });

  it('cannot be where id, place or period cannot be', () => {
    for (const wrong of [{ id: '800' }, { id: 'xyz' }, { start: '7' }, { period: '50' }])
      expect(frameOf({ ...draft, ...wrong }, 2)).toBeUndefined();
    expect(frameOf({ ...draft, id: '800', extended: true }, 2)?.id).toBe(0x800);
  });
});
