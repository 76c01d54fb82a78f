// The catalogues against the source: nothing on a page is outside them, nothing in them is unused.

import { readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import { parse } from 'svelte/compiler';
import { describe, expect, it } from 'vitest';
import en from '../../app/words/en/page.json';
import nb from '../../app/words/nb/page.json';
import vectors from '../../tests/vectors/words.json';
import { Shape } from '../src/store/shape.svelte';
import { render, type Message, type Table } from '../src/words/render';
import { chosen, fill, load, named, t, messageText } from '../src/words/words.svelte';

const SRC = join(import.meta.dirname, '../src');
const EN: Readonly<Record<string, string>> = en;
const NB: Readonly<Record<string, string>> = nb;
// Names, units and formats are the same in every language.
const SAME =
  /^(https?\/\/\S+|car|V|A|B − A|Hz|µs|\(3 sigma\)|kW|kWh|Wh|Ah|mV|mΩ|°C|s|ms|min|kbit\/s|tx|18FF50E5|0E 74 00 00|RS232|CAN|CSV|Parquet|SQLite|MF4|LD|MCAP|DBC|Voltwall|REC|P|C|SOC|EEPROM|chargerflags)$/;
const SHOWN = new Set([
  'title',
  'text',
  'label',
  'aria-label',
  'placeholder',
  'action',
  'caption',
  'data-label',
]);

const files = readdirSync(SRC, { recursive: true, encoding: 'utf8' })
  .map((f) => f.replaceAll('\\', '/'))
  .filter((f) => /\.(svelte|ts)$/.test(f) && !f.startsWith('words/'));
const source = new Map(files.map((f) => [f, readFileSync(join(SRC, f), 'utf8')]));
const placeholders = (text: string): string[] => [...text.matchAll(/\{(\w+)\}/g)].map((m) => m[1]!).sort();

interface Node {
  type?: string;
  [key: string]: unknown;
}
const isNode = (x: unknown): x is Node => typeof x === 'object' && x !== null;
const isText = (s: unknown): boolean =>
  typeof s === 'string' &&
  (s.match(/\p{L}/gu) ?? []).length >= 2 &&
  !SAME.test(s.replace(/[·:,.]/g, '').trim());

/** Texts that a component shows without asking the catalogue. */
function bare(svelte: string): string[] {
  const found: string[] = [];
  const shownValue = (n: Node): void => {
    if (n.type === 'ConditionalExpression') {
      shownValue(n['consequent'] as Node);
      shownValue(n['alternate'] as Node);
    } else if (n.type === 'LogicalExpression') {
      shownValue(n['right'] as Node);
    } else if (n.type === 'Literal' && isText(n['value'])) {
      found.push(String(n['value']));
    } else if (n.type === 'TemplateLiteral') {
      for (const q of n['quasis'] as { value: { cooked: string } }[]) {
        if (isText(q.value.cooked)) found.push(q.value.cooked);
      }
    }
  };
  const walk = (n: unknown): void => {
    if (Array.isArray(n)) n.forEach(walk);
    if (!isNode(n)) return;
    if (n.type === 'Text' && isText(n['data'])) found.push(String(n['data']).trim());
    if (n.type === 'ExpressionTag') shownValue(n['expression'] as Node);
    if (n.type === 'Attribute') {
      if (!SHOWN.has(n['name'] as string) || n['value'] === true) return;
      return walk(n['value']);
    }
    for (const key of [
      'nodes',
      'fragment',
      'body',
      'consequent',
      'alternate',
      'pending',
      'then',
      'catch',
      'fallback',
      'attributes',
    ]) {
      if (key !== 'consequent' && key !== 'alternate') walk(n[key]);
      else if (isNode(n[key]) && (n[key] as Node).type === 'Fragment') walk(n[key]);
    }
  };
  walk(parse(svelte, { modern: true }).fragment);
  return found;
}

describe('words', () => {
  it('finds a bare text in a template, in an attribute and in a condition', () => {
    const page = `<p title="Bare one">Bare two {x ? 'Bare three' : t('common.close')}</p>{#if a}Bare four{/if}`;
    expect(bare(page).sort()).toEqual(['Bare four', 'Bare one', 'Bare three', 'Bare two']);
  });

  it('is asked for every text on a page', () => {
    const missed = files
      .filter((f) => f.endsWith('.svelte'))
      .flatMap((f) => bare(source.get(f)!).map((text) => `${f}: ${text}`));
    expect(missed).toEqual([]);
  }, 30_000); // parses every page, which takes seconds on a busy machine

  it('has no text that nothing shows', () => {
    const all = [...source.values()].join('\n');
    const kinds = new Set([...all.matchAll(/`(\w+\.)\$\{/g)].map((m) => m[1]!)); // `severity.${kind}`
    const unused = Object.keys(EN).filter(
      (code) => !all.includes(`'${code}'`) && !kinds.has(code.replace(/[^.]*$/, '')),
    );
    expect(unused).toEqual([]);
  });

  it('keeps the placeholders of every text', () => {
    const wrong = Object.entries(EN).filter(
      ([code, text]) => placeholders(text).join() !== placeholders(NB[code] ?? '').join(),
    );
    expect(wrong).toEqual([]);
  });

  it('fills values in and leaves an unknown name alone', () => {
    expect(fill('{n} of {m}', { n: 3 })).toBe('3 of {m}');
  });

  it('renders every message of the shared vectors as the service does', () => {
    for (const { message, en, nb } of vectors.cases) {
      expect(render(message as Message, vectors.tables.en as Table, vectors.segments)).toBe(en);
      expect(render(message as Message, vectors.tables.nb as Table, vectors.segments)).toBe(nb);
    }
  });

  it('shows a message in the chosen language, and without one the English text', async () => {
    const message = { code: 'at-cell', args: { cell: { index: 30 } }, text: 'pack 3, cell 7' };
    const unknown = { code: 'no-code-of-this-version', args: {}, text: 'a sentence' };
    const packs = (size: number): Shape => new Shape({ segments: [size, size, size, size] });
    expect(messageText(message, packs(12))).toBe('pack 3, cell 7');
    chosen.words = await load('nb');
    expect(messageText(message, packs(12))).toBe('pakke 3, celle 7');
    expect(messageText(message, packs(10))).toBe('pakke 4, celle 1');
    expect(messageText(unknown)).toBe('a sentence');
    expect(messageText(null)).toBe('');
    chosen.words = null;
  });

  it('shows Norwegian once chosen, names of the data too', async () => {
    chosen.words = await load('nb');
    expect(t('common.pack_cell', { pack: 3, cell: 7 })).toBe('pakke 3, celle 7');
    expect(named('group.fans', 'fans')).toBe('vifter');
    expect(named('group.of tomorrow', 'of tomorrow')).toBe('of tomorrow');
    chosen.words = null;
    expect(named('any', '45 degC and 2 mohm by `serve`')).toBe('45 °C and 2 mΩ by serve');
    expect(t('common.overview')).toBe('Overview');
  });
});
