// What is done with a table as it stands on the page: sort rows by a column, find rows by words, write it as CSV.

import { DASH, MINUS } from '../format';

const SCALES: Readonly<Record<string, number>> = {
  kB: 1e3,
  MB: 1e6,
  GB: 1e9,
  TB: 1e12,
  min: 60,
  h: 3600,
};
const NUMBER = /^([+−-]?\d[\d\u2009]*(?:\.\d+)?)\s*([^\d\s]{0,8})$/;
const CLOCK = /^\d+(?::\d\d){1,2}$/;

/** A cell that is a number and perhaps its unit, else null. */
function measured(text: string): { value: number; digits: string; unit: string } | null {
  const found = NUMBER.exec(text);
  if (!found) return null;
  const digits = found[1]!.replaceAll('\u2009', '').replace(MINUS, '-');
  return { value: Number(digits), digits: digits.replace('+', ''), unit: found[2]! };
}

/** What a cell sorts by: a number, or null where its text is none. */
export function sortValue(text: string): number | null {
  if (CLOCK.test(text)) return text.split(':').reduce((sum, part) => 60 * sum + Number(part), 0);
  const found = measured(text);
  return found && found.value * (SCALES[found.unit] ?? 1);
}

const isMissing = (text: string): boolean => text === '' || text === DASH;

/**
 * The order of rows by the texts of one column: indices into them. Numbers where all are numbers, else as words with the
 * numbers in them; equal rows keep their order, and what is missing comes last either way.
 */
export function orderOf(texts: readonly string[], descending: boolean): number[] {
  const values = texts.map((text) => (isMissing(text) ? null : sortValue(text)));
  const isNumeric = texts.every((text, i) => isMissing(text) || values[i] !== null);
  const words = new Intl.Collator(undefined, { numeric: true });
  const compare = (a: number, b: number): number =>
    isNumeric ? values[a]! - values[b]! : words.compare(texts[a]!, texts[b]!);
  const sign = descending ? -1 : 1;
  const indices = texts.map((_, i) => i);
  const known = indices.filter((i) => !isMissing(texts[i]!)).sort((a, b) => sign * compare(a, b) || a - b);
  return [...known, ...indices.filter((i) => isMissing(texts[i]!))];
}

/** Whether a row has all of the words, in any order. */
export const hasWords = (text: string, words: string): boolean => {
  const low = text.toLowerCase();
  return words
    .toLowerCase()
    .split(/\s+/)
    .every((word) => low.includes(word));
};

const RUNS = /^[=+\-@\t\r\n]/; // what a spreadsheet takes for a formula
const PLAIN = /^[+-]?\d[\d\u2009]*(?:\.\d+)?(?:e[+-]?\d+)?\s?[a-zµΩ°%]{0,8}$/i; // a number, perhaps with its unit

/** The text, or behind a ' what a spreadsheet would run. */
const safe = (text: string): string => (RUNS.test(text) && !PLAIN.test(text) ? `'${text}` : text);

const quoted = (text: string): string => (/[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);

/** Rows as CSV of RFC 4180; no cell is a formula. */
export const csv = (rows: readonly (readonly string[])[]): string =>
  rows.map((row) => row.map(safe).map(quoted).join(',') + '\r\n').join('');

/** A table as CSV: a unit that all numbers of a column share stands in its name, and what is missing is empty. */
export function tableCsv(names: readonly string[], rows: readonly (readonly string[])[]): string {
  const heads = [...names];
  const lines = rows.map((row) => row.map((text) => (isMissing(text) ? '' : text)));
  names.forEach((name, c) => {
    const found = lines.map((line) => (line[c] ? measured(line[c]) : undefined));
    const known = found.filter((each) => each !== undefined);
    if (!known[0] || known.some((each) => each?.unit !== known[0]!.unit)) return;
    if (known[0].unit) heads[c] = `${name} [${known[0].unit}]`;
    found.forEach((each, i) => each && (lines[i]![c] = each.digits));
  });
  return csv([heads, ...lines]);
}
