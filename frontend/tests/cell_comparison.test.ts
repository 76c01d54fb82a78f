import { describe, expect, it } from 'vitest';
import type { Cells } from '../src/link/types';
import { comparison } from '../src/store/cell_comparison';

const N = 5;
const all = <T>(value: T): T[] => Array.from({ length: N }, () => value);
const cells = (changes: Partial<Cells> = {}): Cells => ({
  voltage_v: all(3.7),
  temperature_degc: all(25),
  soc: all(0.5),
  soc_sigma: all(0.005),
  ocv_v: all(3.7),
  residual_v: all(0),
  resistance_ohm: all(0.002),
  capacity_ah: all(25),
  soh_capacity: all(1),
  resistance_factor: all(1),
  joint_excess_ohm: all(0),
  balancing: all(false),
  model_valid: all(true),
  joint_loose: all(false),
  ...changes,
});
const at = <T>(values: T[], index: number, value: T): T[] => values.map((v, i) => (i === index ? value : v));

describe('how a cell compares', () => {
  it('names the weakest, by how much, and its joint', () => {
    const weak = cells({ soc: at(all(0.5), 2, 0.48), resistance_ohm: at(all(0.002), 2, 0.0021) });
    expect(comparison(weak, 2, [1, 3])).toBe(
      'Lowest SOC of 5, 2.0 points below the median. R0 0.10 mΩ above its neighbours. Busbar joint normal.',
    );
  });

  it('says no difference that is smaller than its sigma', () => {
    expect(comparison(cells({ soc: at(all(0.5), 2, 0.497) }), 2, [1, 3])).toMatch(
      /^SOC normal\. R0 normal\./,
    );
  });

  it('does not call a cell the lowest where another one is lower', () => {
    const two = cells({ soc: [0.4, 0.48, 0.5, 0.5, 0.5] });
    expect(comparison(two, 1, [0, 2])).toMatch(/^SOC 2\.0 points below the median\./);
    expect(comparison(cells({ soc: at(all(0.5), 1, 0.53) }), 1, [0, 2])).toMatch(/^SOC 3\.0 points above/);
  });

  it('says what is not known instead of a number', () => {
    const fresh = cells({ soc: all(null), resistance_ohm: all(null), joint_excess_ohm: all(null) });
    expect(comparison(fresh, 0, [1])).toBe(
      'SOC unknown. R0 unknown until under load. Busbar joint not yet assessed.',
    );
    expect(comparison(cells({ voltage_v: at(all(3.7), 0, null) }), 0, [1])).toBe('No voltage reading.');
  });

  it('names a high-resistance joint, and a SOC without a valid model', () => {
    const bad = cells({ joint_loose: at(all(false), 3, true), model_valid: at(all(true), 3, false) });
    expect(comparison(bad, 3, [2, 4])).toMatch(
      /High-resistance busbar joint\. The model does not fit this cell/,
    );
  });
});
