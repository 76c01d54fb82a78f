// The configuration draft, pure: raw counts in, text and differences out. One row for each element of each field.

import type { Maybe, RawConfig, RawValue, SchemaField } from '../link/types';
import { decimalsOf, displayUnit, fixed } from '../format';
import { t } from '../words/words.svelte';

export type Draft = Record<string, Record<number, string>>; // field -> element -> text as typed

export interface Verdict {
  raw: number | null;
  error: string | null;
}

export const flatRaw = (value: RawValue | undefined): number[] =>
  value === undefined ? [] : Array.isArray(value) ? (value.flat() as number[]) : [value];

export const rawAt = (config: RawConfig | null | undefined, field: string, element: number): Maybe<number> =>
  config ? (flatRaw(config[field])[element] ?? null) : null;

export const decimals = (field: SchemaField): number =>
  decimalsOf(field.scale * displayUnit(field.unit).factor);

/** A raw count in the unit people read, with the decimals of one count. */
export function rawText(field: SchemaField, raw: Maybe<number>): string {
  if (raw === null) return fixed(null, 0);
  return fixed(raw * field.scale * displayUnit(field.unit).factor, decimals(field));
}

/** What typed text means for a field: the nearest raw count, or why it cannot be. */
export function judge(field: SchemaField, text: string): Verdict {
  const plain = text.trim().replace('−', '-').replace(',', '.');
  const value = plain === '' ? NaN : Number(plain);
  if (!Number.isFinite(value)) return { raw: null, error: t('common.not_a_number') };
  const raw = Math.round(value / (field.scale * displayUnit(field.unit).factor));
  const unit = displayUnit(field.unit).label;
  if (field.minimum !== null && raw < field.minimum) {
    return {
      raw,
      error: t('common.below_limit', { limit: `${rawText(field, field.minimum)} ${unit}`.trim() }),
    };
  }
  if (field.maximum !== null && raw > field.maximum) {
    return {
      raw,
      error: t('common.above_limit', { limit: `${rawText(field, field.maximum)} ${unit}`.trim() }),
    };
  }
  return { raw, error: null };
}

/** The draft with one element set; text that means the value in force leaves the draft. */
export function edit(
  draft: Draft,
  field: SchemaField,
  element: number,
  text: string,
  inForce: Maybe<number>,
): Draft {
  const verdict = judge(field, text);
  const others = Object.entries(draft[field.name] ?? {}).filter(([key]) => Number(key) !== element);
  const same = verdict.error === null && verdict.raw === inForce;
  const mine = same ? others : [...others, [element, text] as const];
  const rest = Object.entries(draft).filter(([name]) => name !== field.name);
  return Object.fromEntries(
    mine.length > 0 ? [...rest, [field.name, Object.fromEntries(mine)]] : rest,
  ) as Draft;
}

export interface Change {
  field: SchemaField;
  element: number;
  text: string;
  from: Maybe<number>;
  verdict: Verdict;
}

/** Every change of the draft against what is in force, in the order of the struct. */
export function changes(draft: Draft, fields: readonly SchemaField[], inForce: Maybe<RawConfig>): Change[] {
  const found: Change[] = [];
  for (const field of fields) {
    for (const [key, text] of Object.entries(draft[field.name] ?? {})) {
      const element = Number(key);
      found.push({
        field,
        element,
        text,
        from: rawAt(inForce, field.name, element),
        verdict: judge(field, text),
      });
    }
  }
  return found;
}

/** Drop what has meanwhile come into force; keep every other edit. */
export function rebase(draft: Draft, fields: readonly SchemaField[], inForce: RawConfig): Draft {
  let next: Draft = draft;
  for (const { field, element, text, from } of changes(draft, fields, inForce)) {
    next = edit(next, field, element, text, from);
  }
  return next;
}

/** The draft that makes one configuration of another. */
export function draftOf(fields: readonly SchemaField[], inForce: RawConfig, wanted: RawConfig): Draft {
  let draft: Draft = {};
  for (const field of fields) {
    const from = flatRaw(inForce[field.name]);
    flatRaw(wanted[field.name]).forEach((raw, element) => {
      if (raw !== from[element])
        draft = edit(draft, field, element, rawText(field, raw), from[element] ?? null);
    });
  }
  return draft;
}

/** The body of a write: whole raw fields, with the changed elements replaced. */
export function rawBody(all: readonly Change[], inForce: RawConfig): RawConfig {
  const body: RawConfig = {};
  for (const { field, element, verdict } of all) {
    const flat = [...flatRaw(body[field.name] ?? inForce[field.name])];
    flat[element] = verdict.raw!;
    body[field.name] = nest(flat, field.shape);
  }
  return body;
}

function nest(flat: number[], shape: readonly number[]): RawValue {
  if (shape.length === 0) return flat[0]!;
  if (shape.length === 1) return flat;
  const width = shape[1]!;
  return Array.from({ length: shape[0]! }, (_, i) => flat.slice(i * width, (i + 1) * width));
}

/** Elements of a field that differ between two configurations. */
export function differs(field: SchemaField, a: Maybe<RawConfig>, b: Maybe<RawConfig>): boolean {
  if (!a || !b) return false;
  const left = flatRaw(a[field.name]);
  const right = flatRaw(b[field.name]);
  return left.some((value, i) => value !== right[i]);
}
