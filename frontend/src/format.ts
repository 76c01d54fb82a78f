// Every number that a page shows goes through here: units, decimals, signs, and counting from one.

import type { RenderedMessage, SeasonTrend } from './link/types';
import { messageText, t } from './words/words.svelte';
import { shapes } from './store/shape.svelte';

export const DASH = '–';
export const MINUS = '−';
export const STALE_S = 1;
export const BLANK_S = 10;

export type Freshness = 'live' | 'stale' | 'blank';

/** How a value of this age may be shown, live for so long; an age of null was never seen. */
export function freshness(ageS: number | null, liveS: number = STALE_S): Freshness {
  if (ageS === null || ageS >= Math.max(BLANK_S, liveS)) return 'blank';
  return ageS >= liveS ? 'stale' : 'live';
}

export const isLive = (ageS: number | null): boolean => freshness(ageS) === 'live';

/** Fixed decimals with a true minus sign; a missing value is a dash. */
export function fixed(value: number | null | undefined, decimals: number): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  const text = value.toFixed(decimals);
  if (!text.startsWith('-')) return text;
  return Number(text) === 0 ? text.slice(1) : MINUS + text.slice(1);
}

/** A value, or where it is missing the bound that is known of its size: ≥340.4, ≤−3.1. */
export function bounded(
  value: number | null | undefined,
  least: number | null | undefined,
  decimals: number,
): string {
  const bound = fixed(least, decimals);
  if ((value ?? null) !== null || bound === DASH) return fixed(value, decimals);
  return (least! < 0 ? '≤' : '≥') + bound;
}

/** Fixed decimals with a sign, plus too; a missing value is a dash. */
export function signed(value: number | null | undefined, decimals: number): string {
  const text = fixed(value, decimals);
  return text === DASH || text.startsWith(MINUS) ? text : `+${text}`;
}

/** A fraction as percent. */
export const percent = (fraction: number | null | undefined, decimals: number): string =>
  fixed(fraction === null || fraction === undefined ? null : fraction * 100, decimals);

export const scaled = (value: number | null | undefined, factor: number): number | null =>
  value === null || value === undefined ? null : value * factor;

/** "pack 3, cell 7" for index 30 of packs of 12: the only place where one is added for people. */
export function cellName(index: number | null | undefined, shape = shapes.here): string {
  if (index === null || index === undefined) return DASH;
  const place = shape.place(index);
  if (!place) return t('common.cell_lower', { n: index + 1 });
  return t('common.pack_cell', { pack: place.pack + 1, cell: place.position + 1 });
}

export const packNumber = (index: number, shape = shapes.here): number => (shape.place(index)?.pack ?? 0) + 1;
export const cellNumber = (index: number, shape = shapes.here): number =>
  (shape.place(index)?.position ?? index) + 1;
/** Index of a cell by pack and cell as people count them, null where there is none. */
export const cellIndex = (pack: number, cell: number, shape = shapes.here): number | null =>
  shape.cells(pack - 1)[cell - 1] ?? null;
/** Position in any list, as people count it. */
export const ordinal = (index: number): string => String(index + 1);

/** An age in at most five characters: 0.2 s, 14 s, 3 min, 2 h. */
export function age(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined) return DASH;
  if (seconds < 10) return `${Math.max(0, seconds).toFixed(1)} s`;
  if (seconds < 100) return `${Math.floor(seconds)} s`;
  if (seconds < 6000) return `${Math.floor(seconds / 60)} min`;
  return `${Math.floor(seconds / 3600)} h`;
}

/** hours:minutes:seconds, or minutes:seconds below an hour. */
export function duration(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return DASH;
  const s = Math.max(0, Math.floor(seconds));
  const two = (n: number): string => String(n).padStart(2, '0');
  const hours = Math.floor(s / 3600);
  const rest = `${two(Math.floor((s % 3600) / 60))}:${two(s % 60)}`;
  return hours > 0 ? `${hours}:${rest}` : rest;
}

/** A length of time in words: 34 s, 12 min, 2 h 05 min. */
export function span(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return DASH;
  const s = Math.max(0, Math.round(seconds));
  if (s < 90) return `${s} s`;
  const minutes = Math.round(s / 60);
  if (minutes < 120) return `${minutes} min`;
  return `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, '0')} min`;
}

/** Time ahead in at most six characters: 4.2 s, 87 s, 12 min; null is beyond the hour that is looked at. */
export function ahead(seconds: number | null | undefined): string {
  if (seconds === undefined) return DASH;
  if (seconds === null || seconds >= 3600) return '> 1 h';
  if (seconds < 10) return `${Math.max(0, seconds).toFixed(1)} s`;
  return seconds < 100 ? `${Math.floor(seconds)} s` : `${Math.floor(seconds / 60)} min`;
}

/** Local wall time, 14:03:22. */
export function clock(unixS: number | null | undefined): string {
  if (unixS === null || unixS === undefined) return DASH;
  const d = new Date(unixS * 1000);
  return [d.getHours(), d.getMinutes(), d.getSeconds()].map((n) => String(n).padStart(2, '0')).join(':');
}

/** Local date and time, 2026-11-21 14:03. */
export function dateTime(unixS: number | null | undefined): string {
  if (unixS === null || unixS === undefined) return DASH;
  const d = new Date(unixS * 1000);
  const two = (n: number): string => String(n).padStart(2, '0');
  const day = `${d.getFullYear()}-${two(d.getMonth() + 1)}-${two(d.getDate())}`;
  return `${day} ${two(d.getHours())}:${two(d.getMinutes())}`;
}

/** Date and time for documents, which are read anywhere: 2026-11-21 13:03:22 UTC. */
export function utc(unixS: number, milliseconds = false): string {
  const text = new Date(Math.round(unixS * 1000)).toISOString().replace('T', ' ');
  return `${text.slice(0, milliseconds ? 23 : 19)} UTC`;
}

/** Bytes with a decimal prefix: 812 B, 1.4 MB. */
export function bytes(n: number | null | undefined): string {
  if (n === null || n === undefined) return DASH;
  if (n < 1000) return `${n} B`;
  const steps = ['kB', 'MB', 'GB', 'TB'];
  let value = n / 1000;
  let i = 0;
  while (value >= 999.95 && i < steps.length - 1) {
    value /= 1000;
    i++;
  }
  return `${value.toFixed(1)} ${steps[i]}`;
}

/** Whole numbers with a thin space every three digits. */
export function count(n: number | null | undefined): string {
  if (n === null || n === undefined) return DASH;
  return String(Math.round(n)).replace(/\B(?=(\d{3})+$)/g, '\u2009');
}

export const hex = (n: number, digits: number): string => n.toString(16).toUpperCase().padStart(digits, '0');
export const canId = (id: number, extended: boolean): string => `0x${hex(id, extended ? 8 : 3)}`;

/** An address in the pieces between which its line may break: not within a word. */
export const addressPieces = (address: string): string[] => address.split(/(?<=\/\/|[^/][/:?&,;@=_-])(?!\/)/);

export interface DisplayUnit {
  label: string;
  factor: number; // shown = SI * factor
}

const UNITS: Record<string, DisplayUnit> = {
  degC: { label: '°C', factor: 1 },
  ohm: { label: 'mΩ', factor: 1000 },
  mohm: { label: 'mΩ', factor: 1 },
  '1': { label: '%', factor: 100 },
  duty: { label: '%', factor: 100 },
  count: { label: 'counts', factor: 1 },
  byte: { label: 'bytes', factor: 1 },
};

const UNIT_DECIMALS: Record<string, number> = {
  V: 4,
  A: 1,
  mV: 1,
  degC: 0,
  '°C': 0,
  '1': 1,
  '%': 1,
  W: 0,
  ms: 0,
};

/** A value with its unit, for sentences: 4.2013 V, 61 °C. */
export function quantity(value: number | null | undefined, unit: string | null): string {
  const { label, factor } = displayUnit(unit ?? '');
  const decimals = UNIT_DECIMALS[unit ?? ''] ?? 2;
  return `${fixed(scaled(value, factor), decimals)} ${label}`.trim();
}

/** The unit that people read for a unit of the memory map. */
export const displayUnit = (unit: string): DisplayUnit => UNITS[unit] ?? { label: unit, factor: 1 };

/** Decimals that show one count of a field and no more (at most four). */
export function decimalsOf(scale: number): number {
  if (scale >= 1) return 0;
  return Math.min(4, Math.ceil(-Math.log10(scale) - 1e-9));
}

/** What a month changes, with its band; a band that rounds to nothing is no change, however sure. */
export function monthly(trend: SeasonTrend, decimals: number): string {
  const [pace, low, high] = [trend.per_month, trend.low, trend.high].map((v) => signed(100 * v, decimals));
  const least = 10 ** -decimals / 2;
  if (Math.max(Math.abs(trend.low), Math.abs(trend.high)) * 100 < least)
    return t('common.no_significant_change');
  if (!trend.is_reportable) return t('common.too_few_days_monthly_rate');
  const words = t('common.per_month_95', { pace: pace!, low: low!, high: high! });
  return trend.is_sure ? words : `${words} · ${t('common.not_statistically_significant')}`;
}

/** A number stays next to its unit, and a minus is one. */
export const whole = (text: string): string =>
  text
    .replace(/(?<![\p{L}\d])-(?=\d)/gu, MINUS)
    .replace(/(\d) (%|A|V|Ah|mV|K|s|min|h|kWh|°C|mΩ)(?![\p{L}])/gu, '$1\u00a0$2');

/** A finding as a sentence: it begins with a capital letter. */
export const sentence = (message: RenderedMessage): string => capitalised(whole(messageText(message)));

export const capitalised = (text: string): string => text.slice(0, 1).toUpperCase() + text.slice(1);
