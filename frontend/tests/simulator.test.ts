import { describe, expect, it } from 'vitest';
import { faultPath } from '../src/store/simulator.svelte';

const FAULT = { fault: 'joint-resistance-high', value: 2, since_s: 0, until_s: null };

describe('where a fault is cleared', () => {
  it('names the place that the fault has', () => {
    expect(faultPath({ ...FAULT, pack: 3, cell: 7 })).toBe(
      'simulator/faults/joint-resistance-high?pack=3&cell=7',
    );
    expect(faultPath({ ...FAULT, pack: 3, cell: null })).toBe(
      'simulator/faults/joint-resistance-high?pack=3',
    );
  });

  it('names no place where there is none', () => {
    expect(faultPath({ ...FAULT, pack: null, cell: null })).toBe('simulator/faults/joint-resistance-high');
    expect(faultPath(FAULT)).toBe('simulator/faults/joint-resistance-high');
  });
});
