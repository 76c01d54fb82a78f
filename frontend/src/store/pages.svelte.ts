// The pages that there are for what is watched now.

import { battery } from './battery.svelte';
import { live } from './live.svelte';
import { PAGES, type Page } from './route.svelte';

export function pagesNow(): typeof PAGES {
  const needs: Partial<Record<Page, boolean>> = {
    simulator: live.snapshot?.source === 'simulator' && !live.snapshot.replay,
    parameters: battery.now === null || battery.canWrite,
  };
  return PAGES.filter((page) => needs[page.id] ?? true);
}
