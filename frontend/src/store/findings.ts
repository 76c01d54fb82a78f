// What is known against single cells: findings of the service, which stay until evidence ends them.

import type { CellFinding, Maybe, Snapshot } from '../link/types';
import { messageText } from '../words/words.svelte';

/** The findings of one cell, the surest first. */
export const findingsOf = (snapshot: Maybe<Snapshot>, cell: number): CellFinding[] =>
  (snapshot?.findings ?? []).filter((each) => each.cell === cell);

/** What is said of each cell that has a finding. */
export function findingTexts(snapshot: Maybe<Snapshot>): ReadonlyMap<number, string> {
  const texts = new Map<number, string>();
  for (const each of snapshot?.findings ?? []) {
    const before = texts.get(each.cell);
    const text = messageText(each.message);
    texts.set(each.cell, before ? `${before}\n${text}` : text);
  }
  return texts;
}
