import { beforeEach, describe, expect, it } from 'vitest';
import { message } from '../fixtures/battery';
import { makeSnapshot } from '../fixtures/snapshot';
import type { Snapshot } from '../src/link/types';
import { secondsToFull, whyNot } from '../src/store/charging';
import { contradictions, dataWarnings } from '../src/store/data_warnings';
import { live } from '../src/store/live.svelte';

beforeEach(() => Object.assign(live, { connection: 'open', now: 0 })); // whatever another test left

const made = (): Snapshot => makeSnapshot('drive', 10, 1_790_000_000, 1);

function charging(currentA: number): Snapshot {
  const s = made();
  s.master.state = 'charge';
  s.accumulator.current_a = currentA;
  s.cells.soc = s.cells.soc.map((_, i) => (i === 40 ? 0.9 : 0.5));
  s.cells.capacity_ah = s.cells.capacity_ah.map(() => 25);
  return s;
}

describe('secondsToFull', () => {
  it('is the time of the first cell that is full, at the present current', () => {
    expect(secondsToFull(charging(-10))).toBeCloseTo((0.1 * 25 * 3600) / 10);
  });

  it('is unknown while the car does not charge: a current inwards may be noise, or recuperated', () => {
    const s = charging(-10);
    s.master.state = 'fault';
    expect(secondsToFull(s)).toBeNull();
  });

  it('is unknown while nothing flows in', () => {
    expect(secondsToFull(charging(5))).toBeNull();
    expect(secondsToFull(charging(0))).toBeNull();
    expect(secondsToFull(null)).toBeNull();
  });
});

describe('whyNot', () => {
  it('says nothing while charge flows', () => {
    expect(whyNot(charging(-10), true)).toEqual([]);
  });

  it('names what is missing, the worst first', () => {
    const s = charging(0);
    s.master.fit = false;
    s.master.why = message('cell too hot');
    s.master.flags = { ...s.master.flags!, charger: false };
    s.charger.flags = ['input voltage'];
    s.charger.state = 'off';
    expect(whyNot(s, true)).toEqual([
      'The master keeps the shutdown circuit open: cell too hot',
      'No charger on CAN. Check connector, mains and bit rate.',
      'The charger reports a fault: input voltage',
      'Charging has not been started.',
    ]);
  });

  it('does not blame the car where the service is gone', () => {
    live.connection = 'lost';
    expect(whyNot(charging(0), true)).toEqual(['The service does not respond.']);
  });

  it('does not guess from what is old', () => {
    expect(whyNot(charging(0), false)).toEqual(['No data from the charger or the master.']);
  });
});

describe('doubts', () => {
  it('are those of the checks that contradict each other', () => {
    const s = made();
    expect(contradictions(s)).toEqual([]);
    s.plausibility.sum = { ...s.plausibility.sum, verdict: false, value: 3.2 };
    s.plausibility.chips = { ...s.plausibility.chips, verdict: null, value: null };
    expect(contradictions(s)).toEqual(['Sum of cell voltages and accumulator voltage differ by 3.2000 V.']);
  });

  it('tell of an offset of the current sensor that is large and sure', () => {
    const s = made();
    const offset = (a: number | null, sigma: number): string[] => {
      s.estimator.current_offset_a = a;
      s.estimator.current_offset_sigma_a = sigma;
      return dataWarnings(s, null, null);
    };
    expect(offset(null, 0.25)).toEqual([]);
    expect(offset(0.4, 0.05)).toEqual([]);
    expect(offset(1.5, 0.8)).toEqual([]);
    expect(offset(-3, 0.05)).toEqual([
      'The current sensor reads 3.00 ± 0.05 A too low; SOC is corrected for it.',
    ]);
  });

  it('tell of clocks, the disk and lost frames', () => {
    const s = made();
    s.links.rs232.frames = 900;
    s.links.rs232.lost = 100;
    const system = {
      listens_on: '127.0.0.1',
      certificate: null,
      addresses: [],
      disk: { folder: '/data', free_bytes: 5e8, total_bytes: 1e11, recording_hours_left: 1.5 },
      commit_delay_s: 0.31,
      clock: { time: 0, moved_s: -3600, was_set: true },
      readers: [],
    };
    expect(dataWarnings(s, system, 7.4)).toEqual([
      '10.0 % of RS232 frames lost.',
      'Service clock and this device differ by 7 s.',
      'The service clock was adjusted by −3600 s since it started.',
      'Disk full in 1.5 h.',
    ]);
  });
});
