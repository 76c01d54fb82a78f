import { describe, expect, it } from 'vitest';
import { changes, edit, judge, rawBody, rawText, rebase, type Draft } from '../src/store/draft';
import type { RawConfig, SchemaField } from '../src/link/types';

const field = (over: Partial<SchemaField>): SchemaField => ({
  name: 'v_cell_max',
  offset: 4,
  type: 'u16',
  count: 1,
  shape: [],
  unit: 'V',
  scale: 1e-4,
  minimum: 30_000,
  maximum: 45_000,
  default: 42_000,
  range: '3..4.5 V',
  group: 'cell limits',
  live: false,
  meaning: '',
  ...over,
});
const vMax = field({});
const r0 = field({ name: 'r_fs_avg', unit: 'ohm', scale: 1e-5, minimum: 0, maximum: 32_767 });
const table = field({
  name: 'can_tx_msg_data',
  count: 6,
  shape: [2, 3],
  unit: '',
  scale: 1,
  minimum: 0,
  maximum: 65_535,
});
const fields = [vMax, r0, table];
const inForce: RawConfig = {
  v_cell_max: 42_000,
  r_fs_avg: 210,
  can_tx_msg_data: [
    [1, 2, 3],
    [4, 5, 6],
  ],
};

describe('judging typed text', () => {
  it('takes the nearest raw count, with comma, blank and true minus', () => {
    expect(judge(vMax, ' 4,1900 ')).toEqual({ raw: 41_900, error: null });
    expect(judge(vMax, '4.19004').raw).toBe(41_900);
    expect(judge(r0, '2.1').raw).toBe(210);
    expect(judge(field({ minimum: -40, maximum: 40, scale: 1, unit: 'degC' }), '−15').raw).toBe(-15);
  });

  it('names the limit that is broken', () => {
    expect(judge(vMax, '4.6').error).toBe('above the limit of 4.5000 V');
    expect(judge(vMax, '2.9').error).toBe('below the limit of 3.0000 V');
    expect(judge(vMax, '4.5').error).toBeNull();
  });

  it('refuses what is no number', () => {
    for (const text of ['', '  ', 'abc', '4.2 V', 'NaN', 'Infinity'])
      expect(judge(vMax, text).error).toBe('not a number');
  });

  it('writes a count so that reading it gives the count again', () => {
    for (const raw of [30_000, 41_999, 42_000, 45_000]) expect(judge(vMax, rawText(vMax, raw)).raw).toBe(raw);
    for (const raw of [0, 1, 209, 32_767]) expect(judge(r0, rawText(r0, raw)).raw).toBe(raw);
    const duty = field({ scale: 1 / 255, unit: 'duty', minimum: 0, maximum: 255 });
    for (let raw = 0; raw <= 255; raw++) expect(judge(duty, rawText(duty, raw)).raw).toBe(raw);
  });
});

describe('the draft', () => {
  it('holds an edit until it means what is in force again', () => {
    const once = edit({}, vMax, 0, '4.19', 42_000);
    expect(changes(once, fields, inForce).map((c) => [c.field.name, c.from, c.verdict.raw])).toEqual([
      ['v_cell_max', 42_000, 41_900],
    ]);
    expect(edit(once, vMax, 0, '4.2000', 42_000)).toEqual({});
  });

  it('keeps an invalid edit with its reason', () => {
    const draft = edit({}, vMax, 0, '9', 42_000);
    expect(changes(draft, fields, inForce)[0]!.verdict.error).toContain('4.5000 V');
  });

  it('does not change the draft it was given', () => {
    const before: Draft = { r_fs_avg: { 0: '3' } };
    edit(before, vMax, 0, '4.1', 42_000);
    expect(before).toEqual({ r_fs_avg: { 0: '3' } });
  });

  it('sends whole fields, in their shape, with only the edited elements replaced', () => {
    let draft = edit({}, table, 4, '99', 5);
    draft = edit(draft, vMax, 0, '4.1', 42_000);
    expect(rawBody(changes(draft, fields, inForce), inForce)).toEqual({
      v_cell_max: 41_000,
      can_tx_msg_data: [
        [1, 2, 3],
        [4, 99, 6],
      ],
    });
  });

  it('survives a change by somebody else, and drops what has come into force', () => {
    let draft = edit({}, vMax, 0, '4.1', 42_000);
    draft = edit(draft, r0, 0, '3.00', 210);
    const theirs = { ...inForce, v_cell_max: 41_000 };
    expect(rebase(draft, fields, theirs)).toEqual({ r_fs_avg: { 0: '3.00' } });
  });
});
