// A frame for the driver's display, as it is typed.

import type { DriverFrame } from '../link/types';

export interface FrameDraft {
  on: boolean;
  id: string; // hexadecimal
  extended: boolean;
  start: string;
  big: boolean;
  period: string;
}

const whole = (text: string, least: number, most: number): number | undefined => {
  const value = /^\d+$/.test(text.trim()) ? Number(text) : NaN;
  return value >= least && value <= most ? value : undefined;
};

/** The frame that is meant: null where it is off, undefined where it cannot be. */
export function frameOf(draft: FrameDraft, bytes: number): DriverFrame | null | undefined {
  if (!draft.on) return null;
  const text = draft.id.trim().replace(/^0x/i, '');
  const id = /^[0-9a-f]{1,8}$/i.test(text) ? parseInt(text, 16) : NaN;
  const start = whole(draft.start, 0, 8 - bytes);
  const period = whole(draft.period, 100, 10_000);
  if (!(id <= (draft.extended ? 0x1fffffff : 0x7ff)) || start === undefined || period === undefined)
    return undefined;
  return {
    id,
    extended: draft.extended,
    length: 8,
    start_byte: start,
    byte_order: draft.big ? 'big' : 'little',
    period_ms: period,
  };
}
