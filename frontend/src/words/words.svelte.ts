// The page's words: English stands in the code and is the key; the tables of another language are loaded when it is
// chosen. They are in app/words, one folder a language: `page` by the English text, `names` of the service's data by
// their key, `codes` the templates of its messages. A text that has no translation does not compile; that all languages
// have the same keys is a test of the service.

import type page from '../../../app/words/nb/page.json';
import type { RenderedMessage } from '../generated/api';
import { shapes } from '../store/shape.svelte';
import { render, type Table } from './render';

export type Text = keyof typeof page;

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

export interface Tables {
  page: Readonly<Record<string, string>>; // by the English text, and names of the service's data by their key
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

/** `text` in the chosen language, with `{name}` replaced by the value of that name. */
export function t(text: Text, values?: Values): string {
  const words = chosen.words?.page[text] ?? text;
  return values ? fill(words, values) : words;
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
