import { readFileSync } from 'node:fs';
import { describe, expect, it } from 'vitest';
import { makeSnapshot } from '../fixtures/snapshot';
import type { CanMessage, RawConfig, Schema, Snapshot } from '../src/link/types';
import { busLoad, elementName, Image, locate, offsetsOf, runs, UNUSED } from '../src/store/can';

interface Vector {
  name: string;
  image?: string;
  field?: string;
  element?: number;
  raw?: number;
  offsets?: string;
  data?: string;
  kind?: string;
  counts?: string;
  meaning?: string;
}

const read = <T>(path: string): T => JSON.parse(readFileSync(new URL(path, import.meta.url), 'utf8')) as T;
const vectors = (file: string): Vector[] =>
  read<{ vectors: Vector[] }>(`../../tests/vectors/${file}.json`).vectors;
const schema = read<Schema>('../fixtures/schema.json');
const { struct } = schema;
const fieldOf = (name: string) => struct.find((f) => f.name === name)!;

const message = (bytes: number[], over: Partial<CanMessage> = {}): CanMessage => ({
  index: 0,
  enabled: true,
  id: 0x100,
  extended: false,
  period_ms: 100,
  length: bytes.length,
  bytes,
  ...over,
});

describe('finding a byte of the struct', () => {
  it('knows field, element and byte, and padding as nothing', () => {
    expect(locate(struct, 1896 + 2 * 36 + 1)).toMatchObject({ field: { name: 'v' }, element: 36, byte: 1 });
    expect(locate(struct, 0)!.field.name).toBe('conf.ts');
    expect(locate(struct, 2983)).toMatchObject({ field: { name: 'soc' }, byte: 1 });
    expect(locate(struct, 445)).toBeNull();
    expect(locate(struct, 2984)).toBeNull();
  });

  it('finds every element of every field where the picker would put it', () => {
    for (const field of struct) {
      for (const element of [0, field.count - 1]) {
        for (const offset of offsetsOf(field, element, 'big')) {
          expect(locate(struct, offset)).toMatchObject({ field: { name: field.name }, element });
        }
      }
    }
  });

  it.each(vectors('whole_frames').filter((v) => v.kind === 'data'))(
    'knows name, place and scale of every number in the shared frame: $name',
    ({ counts, meaning }) => {
      const words = meaning!.split(' ').filter(Boolean);
      const numbers = counts!.split(' ').filter(Boolean);
      expect(words.length).toBe(numbers.length);
      numbers.forEach((number, i) => {
        const [offset, size, count] = number.split(':').map(Number) as [number, number, number];
        const [name, value] = words[i]!.split('=') as [string, string];
        const place = locate(struct, offset)!;
        expect(elementName(place.field, place.element)).toBe(name);
        expect(offsetsOf(place.field, place.element, 'little')).toEqual(
          Array.from({ length: size }, (_, byte) => offset + byte),
        );
        expect(Number((count * place.field.scale).toPrecision(10))).toBe(Number(value));
      });
    },
  );

  it('names elements of tables by row and column', () => {
    expect(elementName(fieldOf('conf.can_tx_msg_data'), 11)).toBe('conf.can_tx_msg_data[1][3]');
    expect(elementName(fieldOf('v'), 36)).toBe('v[36]');
    expect(elementName(fieldOf('soc'), 0)).toBe('soc');
  });
});

describe('spelling a message', () => {
  it('recognises values in either byte order and joins unused bytes', () => {
    const bytes = [
      ...offsetsOf(fieldOf('charger.v_set'), 0, 'big'),
      ...offsetsOf(fieldOf('soc'), 0, 'little'),
      UNUSED,
      UNUSED,
    ];
    expect(runs(message(bytes), struct).map((r) => [r.name, r.order, r.length])).toEqual([
      ['charger.v_set', 'big', 2],
      ['soc', 'little', 2],
      ['', '', 2],
    ]);
  });

  it('says when a value is cut off or torn', () => {
    const current = offsetsOf(fieldOf('i_fs'), 0, 'little');
    const [cut, torn] = runs(message([current[0]!, current[1]!, current[3]!]), struct);
    expect(cut).toMatchObject({ name: 'i_fs', length: 2, whole: false });
    expect(torn).toMatchObject({ name: 'i_fs byte 3', length: 1 });
  });

  it('covers each byte exactly once for any table', () => {
    for (let seed = 0; seed < 200; seed++) {
      const bytes = Array.from(
        { length: seed % 9 },
        (_, i) => ((seed * 2654435761 + i * 40503) >>> 7) % 3100,
      );
      const spelled = runs(message(bytes), struct);
      expect(spelled.reduce((n, r) => n + r.length, 0)).toBe(bytes.length);
      expect(spelled.map((r) => r.start)).toEqual([...spelled.map((r) => r.start)].sort((a, b) => a - b));
    }
  });
});

describe('the preview of bytes', () => {
  const at = (image: Image, offsets: string): string =>
    offsets
      .split(' ')
      .map((o) => image.at(Number(o)))
      .map((b) => (b === null ? '··' : b.toString(16).padStart(2, '0')))
      .join('');
  const base = makeSnapshot('charge', 0, 0, 0);
  const cases: Record<string, (s: Snapshot) => void> = {
    'charger command 98.0 V 16.0 A, charge': (s) =>
      Object.assign(s.charger, { asked_voltage_v: 98, asked_current_a: 16 }),
    'soc 99.91 %, v_tot 398.50 V, i_fs -0.05 A': (s) => {
      s.master.soc = 0.9991;
      Object.assign(s.accumulator, { voltage_v: 398.5, current_a: -0.05 });
    },
  };

  it.each(Object.entries(cases))('agrees with the shared vector: %s', (name, change) => {
    const vector = vectors('can_messages').find((v) => v.name === name)!;
    const snapshot = structuredClone(base);
    change(snapshot);
    const shown = at(new Image(struct, snapshot, null), vector.offsets!);
    const known = [...shown.matchAll(/../g)].map((m) => m[0]);
    const wanted = [...vector.data!.matchAll(/../g)].map((m) => m[0]);
    expect(known.filter((b) => b !== '··').length).toBeGreaterThanOrEqual(7);
    known.forEach((byte, i) => byte === '··' || expect(byte).toBe(wanted[i]));
  });

  it('spells the default configuration as the shared vector does', () => {
    const all = vectors('config_image');
    const wanted = all.find((v) => v.name === 'default image')!.image!;
    const raw: RawConfig = Object.fromEntries(
      schema.fields.map((f) => [f.name, f.default ?? new Array<number>(f.count).fill(0)]),
    );
    const image = new Image(struct, null, raw);
    for (let offset = 0; offset < 420; offset++) {
      const byte = image.at(offset);
      if (byte !== null)
        expect([offset, byte]).toEqual([offset, parseInt(wanted.slice(2 * offset, 2 * offset + 2), 16)]);
      else expect(locate(struct, offset)).toBeNull();
    }
  });

  it('packs the flags as the master does, the ninth only where it is known', () => {
    const snapshot = structuredClone(base);
    const { offset } = fieldOf('status.flags');
    const flags = (): (number | null)[] =>
      [0, 1].map((i) => new Image(struct, snapshot, null).at(offset + i));
    snapshot.master.flags!.load = true;
    expect(flags()).toEqual([0b11111101, 1]);
    snapshot.master.flags!.load = null;
    expect(flags()).toEqual([0b11111101, null]);
    snapshot.master.flags = null;
    expect(flags()).toEqual([null, null]);
  });

  it('knows the whole charger command', () => {
    const image = new Image(struct, base, null);
    expect(image.at(fieldOf('charger.control').offset)).toBe(0);
  });

  it('does not make up what it cannot know', () => {
    expect(new Image(struct, makeSnapshot('empty', 0, 0, 0), null).at(fieldOf('v').offset)).toBeNull();
    expect(new Image(struct, null, null).at(UNUSED)).toBe(0);
  });
});

describe('bus load', () => {
  it('counts enabled periodic messages with the longest stuffing', () => {
    // 8 data bytes, 11-bit id: 34 + 64 stuffable bits, 24 stuffed, 13 more: 135 bits ten times a second
    expect(busLoad([message(new Array<number>(8).fill(UNUSED))], 500_000)).toBeCloseTo(1350 / 500_000, 12);
    expect(
      busLoad([message([UNUSED], { enabled: false }), message([UNUSED], { period_ms: 0 })], 500_000),
    ).toBe(0);
  });
});
