// A page to print comes from the service in English; here it gets the words of the chosen language.

import { apiUrl } from '../link/rest';
import { chosen, said, saidAll } from './words.svelte';

type Translate = (text: string) => string;

/** `html` with every text of its body and its title translated, and the language named. */
export function inLanguage(html: string, language: string, translate: Translate): string {
  const page = new DOMParser().parseFromString(html, 'text/html');
  const texts = page.createTreeWalker(page.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const node = texts.currentNode as Text;
    const text = node.data.trim();
    if (/\p{L}/u.test(text)) node.data = translate(text);
  }
  page.title = translate(page.title);
  page.documentElement.lang = language;
  return `<!doctype html>\n${page.documentElement.outerHTML}\n`;
}

/** Follow a link to a page to print in the chosen language; English is the service's own page. */
export function openPrinted(event: MouseEvent, path: string): void {
  if (chosen.language === 'en') return;
  event.preventDefault();
  const tab = open('', '_blank'); // at once: later it would be a window that nobody asked for
  void translated(path).then((url) => tab?.location.replace(url));
}

async function translated(path: string): Promise<string> {
  const response = await fetch(apiUrl(path), { cache: 'no-store' });
  if (!response.ok) return apiUrl(path); // says itself what is wrong
  const { PRINTED, PRINTED_PATTERNS } = await import('./nb/printed');
  const fixed: Translate = (text) => {
    const whole = PRINTED[text];
    if (whole !== undefined) return whole;
    for (const [pattern, words] of PRINTED_PATTERNS)
      if (pattern.test(text)) return text.replace(pattern, words);
    const named = /^(.+): (pack \d, cell \d+)$/.exec(text);
    if (named) return `${fixed(named[1]!)}: ${said(named[2]!)}`;
    return saidAll(text);
  };
  const html = inLanguage(await response.text(), chosen.language, fixed);
  return URL.createObjectURL(new Blob([html], { type: 'text/html' }));
}
