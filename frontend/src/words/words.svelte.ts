// The page's words: English stands in the code and is the key; the tables of another language are loaded when it is
// chosen. They are those of the service: app/words, one folder a language. See there for what each file holds.

import type { Said } from './nb';
import { render, type Message, type Table } from './render';
import type { Text } from './texts';

export type { Text };

const FILES = import.meta.glob<Table>(['../../../app/words/*/**/*.json', '!../../../app/words/en/**'], {
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
    const inFolder = path.split('/words/')[1]!.split('/').length > 2; // page/ and names/
    Object.assign(inFolder ? found.page : found.codes, await file());
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
  said = $state.raw<Said | null>(null);

  /** Take the language of the last visit, else the browser's. */
  async start(): Promise<void> {
    const stored = localStorage.getItem(KEY) ?? navigator.language.slice(0, 2).replace(/^n[on]$/, 'nb');
    await this.set(LANGUAGES.find((l) => l.id === stored)?.id ?? 'en', false);
  }

  async set(language: string, keep = true): Promise<void> {
    this.words = language === 'en' ? null : await load(language);
    this.said = language === 'nb' ? (await import('./nb')).SAID : null;
    this.language = language;
    document.documentElement.lang = language;
    if (keep) localStorage.setItem(KEY, language);
  }
}

export const chosen = new Chosen();

/** `text` in the chosen language, with `{name}` replaced by the value of that name. */
export function t(text: Text, values?: Values): string {
  const words = named(text, text);
  return values ? fill(words, values) : words;
}

/** A name of the service's data, as of a scenario, in the chosen language; one that no table knows stays `english`. */
export function named(key: string, english: string): string {
  return chosen.words?.page[key] ?? english;
}

/** What the service says: `words` in the chosen language, or `english` where there are none, as in old sessions. */
export const told = (words: Message | null | undefined, english: string): string =>
  words && chosen.words ? render(words, chosen.words.codes) : english;

export const fill = (text: string, values: Values): string =>
  text.replace(/\{(\w+)\}/g, (whole, name: string) => String(values[name] ?? whole));

/** A sentence of the service in the chosen language; one that no catalogue knows stays as it came. */
export function said(text: string): string {
  const sentence = text.replace(/\s+/g, ' ').trim(); // some come with the line breaks of their file
  return translated(sentence, chosen.said) ?? tidied(sentence);
}

/** A paragraph of the service: a sentence that is not known alone may be so with the one after it. */
export function saidAll(text: string): string {
  const parts = text.split(/(?<=[.:;]) (?=\p{Lu})/u);
  const found: string[] = [];
  for (let i = 0; i < parts.length; i++) {
    const alone = translated(parts[i]!, chosen.said);
    const pair = alone === null ? translated(`${parts[i]!} ${parts[i + 1] ?? ''}`, chosen.said) : null;
    found.push(alone ?? pair ?? said(parts[i]!));
    if (pair !== null) i++;
  }
  return found.join(' ');
}

function translated(sentence: string, catalogue: Said | null): string | null {
  if (!catalogue) return null;
  const whole = catalogue.texts[sentence];
  if (whole !== undefined) return whole;
  for (const [pattern, words] of catalogue.patterns) {
    const found = pattern.exec(sentence);
    if (found) {
      return words
        .replace(/\$(\d)/g, (_, n: string) => said(found[Number(n)] ?? ''))
        .replace(/ +(?=[ :,.])/g, '');
    }
  }
  const opened = /^(\p{Lu})(.*?)(\.?)$/u.exec(sentence); // a text of the log as a sentence of a report
  const inner = opened && translated(opened[1]!.toLowerCase() + opened[2]!, catalogue);
  return inner ? inner[0]!.toUpperCase() + inner.slice(1) + opened[3]! : null;
}

/** Units as people write them, and no mark-up of programs. */
const tidied = (sentence: string): string =>
  sentence
    .replace(/\bdegC\b/g, '°C')
    .replace(/\bmohm\b/g, 'mΩ')
    .replaceAll('`', '');
