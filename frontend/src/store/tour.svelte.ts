// The first five minutes on the pages: what to look at, in which order. Offered until it was done or skipped.

import type { Text } from '../words/words.svelte';
import { Preference } from './preference.svelte';

export interface Step {
  page: string; // address behind #/
  at: string; // what is outlined, as a CSS selector; nothing where the page has no such place now
  title: Text;
  text: Text;
}

export const STEPS: readonly Step[] = [
  {
    page: 'overview',
    at: '[data-testid="link-rs232"]',
    title: 'Is it live?',
    text: 'The bar on top never moves. It says whether both links deliver and how old the values are. What is old is greyed, never shown as new.',
  },
  {
    page: 'overview',
    at: '.overview .alarms',
    title: 'Is anything wrong?',
    text: 'Alarms stand here, the worst first, each with its cell. An octagon means that the master opens the relays.',
  },
  {
    page: 'overview',
    at: '[data-testid="ahead"]',
    title: 'How far does it go?',
    text: 'Power, time to the next limit, energy and laps. Set the laps to go, and each lap has its target. A mark (key l) on the line counts them down.',
  },
  {
    page: 'overview',
    at: '.overview .map',
    title: 'Where is that cell?',
    text: 'Cells are drawn where they sit in the car. A click on any cell, here or in a text, opens its page.',
  },
  {
    page: 'packs/1/1',
    at: 'main .page',
    title: 'How is that cell?',
    text: 'The first sentence says how it compares and why. The evidence is below it.',
  },
  {
    page: 'sessions',
    at: 'main .page',
    title: 'What happened?',
    text: 'Every byte is recorded by itself. A session has its laps, its report, its exports and the black boxes of its trips.',
  },
  {
    page: 'help',
    at: 'main .page',
    title: 'What does it mean?',
    text: 'Help explains every number and shape. Find (key /) leads to any page, cell, session or parameter.',
  },
];

class Tour {
  private readonly seen = new Preference<boolean>('tour', false);
  index = $state<number | null>(null); // of the step that is shown; null: none

  /** Nobody did or skipped it in this browser. */
  get isOffered(): boolean {
    return !this.seen.value && this.index === null;
  }

  get step(): Step | null {
    return this.index === null ? null : (STEPS[this.index] ?? null);
  }

  /** Show a step, and its page; beyond the last it is over. */
  go(index: number): void {
    const step = STEPS[index];
    if (!step) return this.end();
    this.index = index;
    location.hash = `#/${step.page}`;
  }

  end(): void {
    this.index = null;
    this.seen.value = true;
  }
}

export const tour = new Tour();
