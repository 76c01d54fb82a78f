import { describe, expect, it } from 'vitest';
import type { SessionEvent } from '../src/link/types';
import { alarmSpans, extremesBetween, lanes, readingAt, within } from '../src/store/session_readings';

const band = { time: [0, 1, 2, 3, 4], min: [5, 4, null, 1, 7], max: [6, 8, null, 2, 7] };

const event = (time: number, code: string, severity: SessionEvent['severity']): SessionEvent => ({
  id: time,
  time,
  severity,
  code,
  message: { code, args: {}, text: code },
  cell: null,
  value: null,
  limit: null,
  unit: '',
  who: null,
});

describe('readingAt', () => {
  it('is the nearest point, with both extremes', () => {
    expect(readingAt(band, 1.2)).toEqual({ low: 4, high: 8 });
    expect(readingAt(band, 3.6)).toEqual({ low: 7, high: 7 });
  });

  it('is nothing in a gap, beyond the ends, and without data', () => {
    expect(readingAt(band, 2)).toBeNull();
    expect(readingAt(band, 40)).toBeNull();
    expect(readingAt({ time: [], min: [], max: [] }, 0)).toBeNull();
  });
});

describe('extremesBetween', () => {
  it('passes over gaps', () => {
    expect(extremesBetween(band, 1, 3)).toEqual({ low: 1, high: 8 });
  });

  it('is nothing where nothing was recorded', () => {
    expect(extremesBetween(band, 1.5, 2.5)).toBeNull();
  });
});

describe('alarmSpans', () => {
  const spans = alarmSpans(
    [
      event(10, 'cell-overtemperature', 'trip'),
      event(11, 'command', 'info'),
      event(14, 'cell-overtemperature', 'info'),
      event(20, 'rs232-silent', 'warning'),
    ],
    60,
  );

  it('end with the event that ends them, else with the session', () => {
    expect(spans.map((s) => [s.code, s.from, s.to])).toEqual([
      ['cell-overtemperature', 10, 14],
      ['rs232-silent', 20, 60],
    ]);
  });

  it('of the master end with its own words, and a start has no length', () => {
    const own = alarmSpans(
      [
        event(1, 'boot', 'watch'),
        event(2, 'eeprom-invalid', 'warning'),
        event(3, 'trip-cell-overtemperature', 'trip'),
        event(5, 'faults-cleared', 'info'),
        event(7, 'config-stored', 'info'),
      ],
      60,
    );
    expect(own.map((s) => [s.code, s.from, s.to])).toEqual([
      ['boot', 1, 1],
      ['eeprom-invalid', 2, 7],
      ['trip-cell-overtemperature', 3, 5],
    ]);
  });

  it('lie in one lane a code, the worst on top', () => {
    const again = alarmSpans([event(1, 'a', 'watch'), event(2, 'b', 'trip'), event(3, 'a', 'watch')], 9);
    expect(lanes(again).map((row) => [row[0]!.code, row.length])).toEqual([
      ['b', 1],
      ['a', 2],
    ]);
  });
});

describe('within', () => {
  it('keeps the width and stays inside', () => {
    expect(within([-5, 5], [0, 100])).toEqual([0, 10]);
    expect(within([95, 105], [0, 100])).toEqual([90, 100]);
    expect(within([-50, 300], [0, 100])).toEqual([0, 100]);
  });
});
