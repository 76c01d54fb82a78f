// Gives a table its tools: `<table {@attach tools('laps')}>`.

import { mount, unmount } from 'svelte';
import type { Attachment } from 'svelte/attachments';
import TableTools from './TableTools.svelte';

interface Options {
  finds?: boolean; // rows by words: always or never; else where they are many
  onuse?: () => void; // before rows are sorted, found or copied, so that a shortened table can show all of them
}

/** Sort, find and copy for one table of a page, by its name in the address and of the file. */
export const tools =
  (name: string, options: Options = {}): Attachment<HTMLTableElement> =>
  (table) => {
    if (table.closest('.sheet')) return; // a document to print
    const made = mount(TableTools, {
      target: table.parentElement!,
      anchor: table,
      props: { table, name, ...options },
    });
    return () => void unmount(made);
  };

// An element that scrolls can be reached by the keyboard while it does, and is no stop on the way otherwise.
export function scrollable(node: HTMLElement): () => void {
  const look = (): void => {
    const scrolls = node.scrollWidth > node.clientWidth || node.scrollHeight > node.clientHeight;
    if (scrolls) node.tabIndex = 0;
    else node.removeAttribute('tabindex');
  };
  const observer = new ResizeObserver(look);
  observer.observe(node);
  for (const child of node.children) observer.observe(child);
  return () => observer.disconnect();
}
