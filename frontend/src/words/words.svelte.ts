// The texts of the pages by code, in app/words, one folder a language: `page` the texts of the pages, `names` of the
// service's data by their key, `codes` the templates of its messages. English is always there; the tables of another
// language are loaded when it is chosen. A code that the English table lacks does not compile, nor a missing value;
// that all languages have the same codes is a test of the service.

import page from '../../../app/words/en/page.json';
import type { RenderedMessage } from '../generated/api';
import { shapes } from '../store/shape.svelte';
import type { Texts } from '../generated/texts';
import { render, type Table } from './render';

/** The code of any text of the pages. */
export type Code = keyof Texts;
/** The code of a text that takes no values. */
export type Text = { [C in Code]: Texts[C] extends null ? C : never }[Code];

const FILES = import.meta.glob<Table>(['../../../app/words/*/*.json', '!../../../app/words/en/*'], {
  import: 'default',
});
const languageOf = (path: string): string => path.split('/words/')[1]!.split('/')[0]!;
const nameOf = (id: string): string => {
  const name = new Intl.DisplayNames([id], { type: 'language' }).of(id) ?? id;
  return name[0]!.toUpperCase() + name.slice(1);
};

export const LANGUAGES: readonly { id: string; name: string }[] = [
  'en',
  ...Object.keys(FILES).map(languageOf),
]
  .filter((id, i, all) => all.indexOf(id) === i)
  .map((id) => ({ id, name: nameOf(id) }));

const KEY = 'voltwall.language';
type Values = Record<string, string | number>;
type ValuesOf<C extends Code> = Texts[C] extends null
  ? []
  : [values: Record<NonNullable<Texts[C]>, string | number>];
const EN: Readonly<Record<string, string>> = page;

export interface Tables {
  page: Readonly<Record<string, string>>; // by code, and names of the service's data by their key
  codes: Table;
}

/** The tables of a language. */
export async function load(language: string): Promise<Tables> {
  const found: Tables = { page: {}, codes: {} };
  const read = async ([path, file]: [string, () => Promise<Table>]): Promise<void> => {
    Object.assign(path.endsWith('/codes.json') ? found.codes : found.page, await file());
  };
  await Promise.all(
    Object.entries(FILES)
      .filter(([path]) => languageOf(path) === language)
      .map(read),
  );
  return found;
}

class Chosen {
  language = $state('en');
  words = $state.raw<Tables | null>(null); // null in English

  /** Take the language of the last visit, else the browser's. */
  async start(): Promise<void> {
    const stored = localStorage.getItem(KEY) ?? navigator.language.slice(0, 2).replace(/^n[on]$/, 'nb');
    await this.set(LANGUAGES.find((l) => l.id === stored)?.id ?? 'en', false);
  }

  async set(language: string, keep = true): Promise<void> {
    this.words = language === 'en' ? null : await load(language);
    this.language = language;
    document.documentElement.lang = language;
    if (keep) localStorage.setItem(KEY, language);
  }
}

export const chosen = new Chosen();

/** The English text of a code, with `{name}` replaced by the value of that name. */
export const english = (code: Code, values: Values = {}): string => fill(EN[code] ?? code, values);

/** The text of a code in the chosen language, with `{name}` replaced by the value of that name. */
export function t<C extends Code>(code: C, ...[values]: ValuesOf<C>): string {
  return fill(chosen.words?.page[code] ?? EN[code] ?? code, values ?? {});
}

/** A name of the service's data, as of a scenario, in the chosen language; one that no table knows stays English. */
export const named = (key: string, english: string): string => chosen.words?.page[key] ?? tidied(english);

/** A message of the service in the chosen language; in English, and where no table knows it, its text as it came. */
export function messageText(message: RenderedMessage | null | undefined, shape = shapes.here): string {
  if (!message) return '';
  const codes = chosen.words?.codes;
  return codes && message.code in codes
    ? render(message, codes, shape.outline.segments)
    : tidied(message.text);
}

export const fill = (text: string, values: Values): string =>
  text.replace(/\{(\w+)\}/g, (whole, name: string) => String(values[name] ?? whole));

/** Units as people write them, no mark-up of programs, and no line breaks of the files that texts come from. */
const tidied = (sentence: string): string =>
  sentence
    .replace(/\s+/g, ' ')
    .trim()
    .replace(/\bdegC\b/g, '°C')
    .replace(/\bmohm\b/g, 'mΩ')
    .replaceAll('`', '');
