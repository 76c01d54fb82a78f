// While a page is printed its charts are drawn for the width of the paper, and its colours are those of the light theme.

import { flushSync } from 'svelte';

export const PAPER_PX = 700; // A4 without its margins, at 96 pixels an inch
export const PAPER_THIRD_PX = 550; // a third of A4 across, as print.css shrinks the overview

class Paper {
  isPrinting = $state(false);

  start(): void {
    const root = document.documentElement.dataset;
    let theme = root['theme'];
    addEventListener('beforeprint', () => {
      if (this.isPrinting) return;
      theme = root['theme'];
      root['theme'] = 'light';
      flushSync(() => (this.isPrinting = true)); // what is printed is what stands there when this returns
    });
    addEventListener('afterprint', () => {
      if (theme) root['theme'] = theme;
      this.isPrinting = false;
    });
  }
}

export const paper = new Paper();
