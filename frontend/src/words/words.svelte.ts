// The page's words: English stands in the code and is the key; another language is a catalogue that is loaded when it
// is chosen. A text that a catalogue lacks does not compile, so a language is complete or it is not built.

import type { Said, Words } from './nb';

export type Text = keyof Words;
export type Language = 'en' | 'nb';

export const LANGUAGES: readonly { id: Language; name: string }[] = [
  { id: 'en', name: 'English' },
  { id: 'nb', name: 'Norsk' },
];

const KEY = 'voltwall.language';
type Values = Record<string, string | number>;

class Chosen {
  language = $state<Language>('en');
  words = $state.raw<Words | null>(null);
  said = $state.raw<Said | null>(null);

  /** Take the language of the last visit, else the browser's. */
  async start(): Promise<void> {
    const kept = localStorage.getItem(KEY) ?? navigator.language.slice(0, 2).replace(/^n[on]$/, 'nb');
    await this.set(LANGUAGES.find((l) => l.id === kept)?.id ?? 'en', false);
  }

  async set(language: Language, keep = true): Promise<void> {
    const catalogue = language === 'nb' ? await import('./nb') : null;
    this.words = catalogue?.NB ?? null;
    this.said = catalogue?.SAID ?? null;
    this.language = language;
    document.documentElement.lang = language;
    if (keep) localStorage.setItem(KEY, language);
  }
}

export const chosen = new Chosen();

/** `text` in the chosen language, with `{name}` replaced by the value of that name. */
export function t(text: Text, values?: Values): string {
  const words: string = chosen.words?.[text] ?? text;
  return values ? fill(words, values) : words;
}

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
