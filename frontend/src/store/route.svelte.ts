// Where the reader is: the hash of the address, so that any place can be shared as a link.

import type { Text } from '../words/words.svelte';

export type Page =
  | 'overview'
  | 'packs'
  | 'charging'
  | 'parameters'
  | 'can'
  | 'sessions'
  | 'season'
  | 'events'
  | 'system'
  | 'simulator'
  | 'help'
  | 'setup'
  | 'judge';

export const PAGES: readonly { id: Page; name: Text; icon: string }[] = [
  { id: 'overview', name: 'common.overview', icon: 'gauge' },
  { id: 'packs', name: 'common.packs', icon: 'grid' },
  { id: 'charging', name: 'common.charging', icon: 'plug' },
  { id: 'parameters', name: 'common.parameters', icon: 'sliders' },
  { id: 'can', name: 'common.can', icon: 'bus' },
  { id: 'sessions', name: 'common.sessions', icon: 'record' },
  { id: 'season', name: 'common.season', icon: 'season' },
  { id: 'events', name: 'common.events', icon: 'list' },
  { id: 'system', name: 'common.system', icon: 'pulse' },
  { id: 'simulator', name: 'common.simulator', icon: 'flask' },
  { id: 'help', name: 'common.help', icon: 'help' },
];

export interface Place {
  page: Page;
  unknown: string | null; // the address, where there is no such page
  args: string[];
  query: URLSearchParams;
}

/** Decode a part of an address; one that is no valid encoding stays as it is. */
function decoded(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

/** Split "#/packs/3/7?a=1" into page, arguments and query; an unknown page is the overview. */
export function parseHash(hash: string): Place {
  const [path = '', query = ''] = hash.replace(/^#\/?/, '').split('?');
  const [first = '', ...args] = path.split('/').filter(Boolean).map(decoded);
  const known = first === 'judge' || first === 'setup' || PAGES.some((p) => p.id === first);
  const unknown = known || first === '' ? null : `#/${path}`;
  // eslint-disable-next-line svelte/prefer-svelte-reactivity -- made anew with every address, never changed
  return { page: known ? (first as Page) : 'overview', unknown, args, query: new URLSearchParams(query) };
}

/** The address of another place that shows what this one does, but for the part of charts in view: that is of here. */
export function sibling(path: string, hash: string): string {
  const { query } = parseHash(hash);
  for (const name of [...query.keys()]) if (/^(from|to)-/.test(name)) query.delete(name);
  const text = query.toString();
  return `#/${path}${text ? `?${text}` : ''}`;
}

class Route {
  hash = $state(location.hash);
  arrivals = $state(0); // counts the reader's own steps; what a page notes is none
  here = $derived(parseHash(this.hash));

  /** Put what is shown into the address, so that it can be shared; null takes a value out. The reader stays here. */
  note(values: Record<string, string | null>): void {
    if (location.hash !== this.hash) return; // the reader has left already, `hashchange` is on its way
    const { query } = parseHash(this.hash);
    for (const [name, value] of Object.entries(values)) {
      if (value === null) query.delete(name);
      else query.set(name, value);
    }
    const text = query.toString();
    history.replaceState(null, '', `${this.hash.split('?')[0] || '#/overview'}${text ? `?${text}` : ''}`);
    this.hash = location.hash;
  }

  /** Let what is noted next be a place of its own, from which the browser goes back to this one. */
  step(): void {
    if (location.hash === this.hash) history.pushState(null, '', this.hash);
  }

  start(): void {
    addEventListener('hashchange', () => {
      this.hash = location.hash;
      this.arrivals++;
    });
  }
}

export const route = new Route();
