// What the Season page says of a month.

import { describe, expect, it } from 'vitest';
import { monthly } from '../src/format';

const trend = {
  now: 0.8,
  per_month: 0.01,
  low: 0.005,
  high: 0.015,
  sessions: 6,
  is_sure: true,
  is_reportable: true,
};

describe('monthly', () => {
  it('tells the pace with its band', () => {
    expect(monthly(trend, 1)).toBe('+1.0 % per month (95 %: +0.5 to +1.5)');
    expect(monthly({ ...trend, is_sure: false }, 1)).toContain('not statistically significant');
  });

  it('tells no month by the sessions of one day', () => {
    const day = { ...trend, per_month: -269, low: -406, high: -132, is_reportable: false };
    expect(monthly(day, 1)).toBe('too few days for a monthly rate');
  });
});
