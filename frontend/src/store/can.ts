// CAN tables, pure: which byte of the struct an offset is, what a run of bytes spells, and the bytes as they are now.

import type { DriverFrame, CanMessage, Flags, Maybe, RawConfig, Snapshot, StructField } from '../link/types';
import { MASTER_SIZE } from '../generated/memory_map';
import { flatRaw } from './draft';

export const UNUSED = 0xffff;

/** Whether a row of the tables is a message at all. */
export const isUsed = (message: CanMessage): boolean =>
  message.length > 0 || message.enabled || message.id !== 0;
export const ITEM_SIZE: Record<string, number> = { u8: 1, i8: 1, u16: 2, i16: 2, u32: 4, i32: 4 };
const CODES: Record<string, string> = { b: 'i8', B: 'u8', h: 'i16', H: 'u16', i: 'i32', I: 'u32' };

export const typeOf = (field: { type: string }): string => CODES[field.type] ?? field.type;
export const itemSize = (field: { type: string }): number => ITEM_SIZE[typeOf(field)] ?? 1;

export interface Place {
  field: StructField;
  element: number;
  byte: number;
}

/** The byte at `offset`, or null for padding. */
export function locate(struct: readonly StructField[], offset: number): Place | null {
  let low = 0;
  let high = struct.length - 1;
  while (low <= high) {
    const middle = (low + high) >>> 1;
    const field = struct[middle]!;
    const size = itemSize(field);
    if (offset < field.offset) high = middle - 1;
    else if (offset >= field.offset + size * field.count) low = middle + 1;
    else {
      const within = offset - field.offset;
      return { field, element: Math.floor(within / size), byte: within % size };
    }
  }
  return null;
}

export function elementName(field: StructField, element: number): string {
  if (field.count <= 1) return field.name;
  if (field.shape.length < 2) return `${field.name}[${element}]`;
  const width = field.shape[1]!;
  return `${field.name}[${Math.floor(element / width)}][${element % width}]`;
}

export interface Run {
  start: number;
  length: number;
  name: string; // '' for bytes that are not used
  order: 'little' | 'big' | '';
  whole: boolean;
}

/** What the bytes of a message spell: whole elements in either order, lone bytes, unused ones. */
export function runs(message: CanMessage, struct: readonly StructField[]): Run[] {
  const found: Run[] = [];
  let at = 0;
  while (at < message.length) {
    const run = runAt(message.bytes.slice(0, message.length), at, struct);
    const last = found.at(-1);
    if (run.name === '' && last?.name === '') last.length += run.length;
    else found.push(run);
    at += run.length;
  }
  return found;
}

function runAt(bytes: readonly number[], at: number, struct: readonly StructField[]): Run {
  const first = bytes[at] ?? UNUSED;
  if (first === UNUSED) return { start: at, length: 1, name: '', order: '', whole: false };
  const place = locate(struct, first);
  if (!place) return { start: at, length: 1, name: `offset ${first}`, order: '', whole: false };
  const size = itemSize(place.field);
  const name = elementName(place.field, place.element);
  if (size === 1) return { start: at, length: 1, name, order: '', whole: true };
  for (const order of ['little', 'big'] as const) {
    const start = order === 'little' ? first - place.byte : first - place.byte + size - 1;
    if (start !== first) continue;
    const step = order === 'little' ? 1 : -1;
    let length = 1;
    while (length < size && bytes[at + length] === first + step * length) length++;
    if (length > 1) return { start: at, length, name, order, whole: length === size };
  }
  return { start: at, length: 1, name: `${name} byte ${place.byte}`, order: '', whole: false };
}

/** The offsets that put an element into a message in a byte order. */
export function offsetsOf(field: StructField, element: number, order: 'little' | 'big'): number[] {
  const size = itemSize(field);
  const base = field.offset + element * size;
  const up = Array.from({ length: size }, (_, i) => base + i);
  return order === 'little' ? up : up.reverse();
}

const FLAGS: readonly (keyof Flags)[] = [
  'fit',
  'usb',
  'i2c1',
  'usart1',
  'can1',
  'charger',
  'charging',
  'balancing',
  'load',
];

/** As much of the master's struct as the page can rebuild from what it knows; NaN where it cannot. */
export class Image {
  private readonly bytes = new Float64Array(MASTER_SIZE).fill(NaN);

  constructor(struct: readonly StructField[], snapshot: Maybe<Snapshot>, config: Maybe<RawConfig>) {
    const byName = new Map(struct.map((f) => [f.name, f]));
    const put = (name: string, values: readonly Maybe<number>[]): void => {
      const field = byName.get(name);
      if (!field) return;
      values.forEach((value, i) => value !== null && this.write(field, i, Math.round(value / field.scale)));
    };
    for (const [name, raw] of Object.entries(config ?? {})) {
      const field = byName.get(`conf.${name}`) ?? byName.get(name);
      if (field) flatRaw(raw).forEach((value, i) => this.write(field, i, value));
    }
    if (!snapshot) return;
    const { cells, accumulator: a, master, charger } = snapshot;
    put('v', cells.voltage_v);
    put('t', cells.temperature_degc);
    put('i_fs', [a.current_a]);
    put('v_tot', [a.voltage_v]);
    put('v_min', [a.voltage_min_v]);
    put('v_max', [a.voltage_max_v]);
    put('v_avg', [a.voltage_mean_v]);
    put('v_min_id', [a.voltage_min_cell]);
    put('v_max_id', [a.voltage_max_cell]);
    put('t_min', [a.temperature_min_degc]);
    put('t_max', [a.temperature_max_degc]);
    put('t_min_id', [a.temperature_min_cell]);
    put('t_max_id', [a.temperature_max_cell]);
    put('soc', [master.soc]);
    put('n_slaves', [master.n_slaves]);
    put('charger.v_set', [charger.asked_voltage_v]);
    put('charger.i_set', [charger.asked_current_a]);
    put('charger.v_out', [charger.voltage_v]);
    put('charger.i_out', [charger.current_a]);
    put('charger.control', [charger.enabled === null ? null : Number(!charger.enabled)]);
    put('charger.fan_duty', [a.fan_duty]);
    put('status.can_tx_msg_en', [master.can_tx_enabled]);
    put('status.can_rx_msg_en', [master.can_rx_enabled]);
    put('status.can_rx_msg_active', [master.can_rx_active]);
    put('dod', [master.charge_drawn_ah]);
    const flags = byName.get('status.flags');
    if (flags && master.flags) this.writeFlags(flags.offset, master.flags);
  }

  /** CAN alone may have brought the first eight: then the byte of the ninth is not known. */
  private writeFlags(offset: number, flags: Flags): void {
    const bits = FLAGS.reduce((sum, name, bit) => sum | (Number(flags[name] ?? false) << bit), 0);
    this.bytes[offset] = bits & 0xff;
    if (flags.load !== null) this.bytes.set([bits >> 8, 0, 0], offset + 1);
  }

  /** The byte at an offset, 0 for an unused place, null when it is not known here. */
  at(offset: number): number | null {
    if (offset === UNUSED) return 0;
    const byte = this.bytes[offset];
    return byte === undefined || Number.isNaN(byte) ? null : byte;
  }

  private write(field: StructField, element: number, value: number): void {
    const size = itemSize(field);
    const base = field.offset + element * size;
    for (let i = 0; i < size; i++) this.bytes[base + i] = Math.floor(value / 2 ** (8 * i)) & 0xff;
  }
}

/** Share of the bus that the enabled messages take, worst case with bit stuffing. */
export function busLoad(messages: readonly CanMessage[], bitRate: number): number {
  let bits = 0;
  for (const m of messages) {
    if (!m.enabled || !m.period_ms) continue;
    const stuffed = (m.extended ? 54 : 34) + 8 * m.length;
    const frame = stuffed + Math.floor((stuffed - 1) / 4) + 13;
    bits += (frame * 1000) / m.period_ms;
  }
  return bits / bitRate;
}

// A frame for the driver's display, as it is typed.
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
