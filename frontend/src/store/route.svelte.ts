// Where the reader is: the hash of the address, so that any place can be shared as a link.

import type { Text } from '../words/words.svelte';

export type Page =
  | 'overview'
  | 'packs'
  | 'charging'
  | 'parameters'
  | 'can'
  | 'sessions'
  | 'events'
  | 'system'
  | 'simulator'
  | 'help'
  | 'judge';

export const PAGES: readonly { id: Page; name: Text; icon: string }[] = [
  { id: 'overview', name: 'Overview', icon: 'gauge' },
  { id: 'packs', name: 'Packs', icon: 'grid' },
  { id: 'charging', name: 'Charging', icon: 'plug' },
  { id: 'parameters', name: 'Parameters', icon: 'sliders' },
  { id: 'can', name: 'CAN', icon: 'bus' },
  { id: 'sessions', name: 'Sessions', icon: 'record' },
  { id: 'events', name: 'Events', icon: 'list' },
  { id: 'system', name: 'System', icon: 'pulse' },
  { id: 'simulator', name: 'Simulator', icon: 'flask' },
  { id: 'help', name: 'Help', icon: 'help' },
];

/** Split "#/packs/3/7" into page and arguments; an unknown page is the overview. */
export function parseHash(hash: string): { page: Page; args: string[] } {
  const [first = '', ...args] = hash.replace(/^#\/?/, '').split('/').filter(Boolean).map(decodeURIComponent);
  const known = first === 'judge' || PAGES.some((p) => p.id === first);
  return { page: known ? (first as Page) : 'overview', args };
}

class Route {
  hash = $state(location.hash);
  here = $derived(parseHash(this.hash));

  start(): void {
    addEventListener('hashchange', () => (this.hash = location.hash));
  }
}

export const route = new Route();
