// Which entries of the command palette fit what was typed: words in any order, and cells by their numbers.

import type { Shape } from './shape.svelte';

export interface Entry {
  id: string;
  name: string;
  /** What it is, in addition to its name. */
  detail: string;
  /** Looked through, but not shown. */
  also?: string;
  key?: string;
  /** One of many: not listed before something is typed. */
  hidden?: boolean;
  /** What the service is asked for: the palette stays until it is done, and shows a failure. */
  waits?: boolean;
  act: () => void | Promise<void>;
}

const LETTERS: Record<string, string> = { ø: 'o', æ: 'ae', ß: 'ss', đ: 'd', ł: 'l' };

/** Small letters without their marks, so that "okter" finds "Økter". */
export const folded = (text: string): string =>
  text
    .toLowerCase()
    .normalize('NFD')
    .replace(/\p{M}/gu, '')
    .replace(/[øæßđł]/g, (letter) => LETTERS[letter]!);

const wordsOf = (text: string): string[] =>
  folded(text)
    .split(/[^\p{L}\p{N}]+/u)
    .filter(Boolean);

/** The entries that hold every word of `typed`, those whose name begins with them first. */
export function fitting(entries: readonly Entry[], typed: string): Entry[] {
  const words = wordsOf(typed);
  if (words.length === 0) return entries.filter((e) => !e.hidden);
  return entries
    .map((entry) => ({ entry, rank: rankOf(entry, words) }))
    .filter(({ rank }) => rank < Infinity)
    .sort((a, b) => a.rank - b.rank)
    .map(({ entry }) => entry);
}

/** How far the words are from the beginning of a name, infinite where one is missing. */
function rankOf(entry: Entry, words: readonly string[]): number {
  const name = wordsOf(entry.name);
  const rest = folded(`${entry.detail} ${entry.also ?? ''}`);
  const rank = (word: string): number => {
    if (name[0]?.startsWith(word)) return 0;
    if (name.some((each) => each.startsWith(word))) return 1;
    if (name.some((each) => each.includes(word))) return 2;
    return rest.includes(word) ? 8 : Infinity; // one word outside the name weighs more than several in it
  };
  return words.reduce((sum, word) => sum + rank(word), 0);
}

export interface Found {
  /** From 1, as people count. */
  pack: number;
  /** From 1 in its pack; null is the whole pack. */
  cell: number | null;
}

/**
 * Packs and cells that `typed` means: "3 7" and "p3 c7" a cell in its pack, "p3" a pack, "c31" a cell of the string,
 * "31" either. `names` are the words for a pack and for a cell, of which a beginning is enough.
 */
export function placesIn(
  typed: string,
  shape: Shape,
  names: { pack: readonly string[]; cell: readonly string[] },
): Found[] {
  const NUMBER = /(\p{L}*)[\s.]*(\d+)/gu;
  const text = folded(typed);
  if (/[^\s,.:;/-]/.test(text.replace(NUMBER, ''))) return [];
  const begins = (all: readonly string[], word: string): boolean =>
    all.some((each) => folded(each).startsWith(word));
  const numbers = [...text.matchAll(NUMBER)].map(([, word = '', digits = '']) => ({
    n: Number(digits),
    isCell: begins(names.cell, word), // no word at all begins both
    isPack: begins(names.pack, word),
  }));

  const ofPack = (pack: number): Found[] => (pack >= 1 && pack <= shape.nPacks ? [{ pack, cell: null }] : []);
  const ofString = (n: number): Found[] => {
    const place = shape.place(n - 1);
    return place ? [{ pack: place.pack + 1, cell: place.position + 1 }] : [];
  };
  const inPack = (pack: number, cell: number): Found[] =>
    cell >= 1 && cell <= shape.size(pack - 1) ? [{ pack, cell }] : [];

  const [a, b] = numbers;
  if (a && !b) return [...(a.isPack ? ofPack(a.n) : []), ...(a.isCell ? ofString(a.n) : [])];
  if (!a || !b || numbers.length > 2) return [];
  if (a.isPack && b.isCell) return inPack(a.n, b.n);
  return a.isCell && b.isPack ? inPack(b.n, a.n) : [];
}
