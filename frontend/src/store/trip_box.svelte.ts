// Where the black box of a trip is. It is complete some seconds after the trip, so it is asked for until it is there.

import { get, Problem } from '../link/rest';
import type { BoxList, Maybe } from '../link/types';

const LIST = '#/sessions/boxes';
const EVERY_MS = 3000;
const TRIES = 20;
const NEAR_S = 30; // a box holds what came within seconds of its first trigger

export class TripBox {
  href = $state(LIST);

  /** Look for the box of a trip at `since` [unix s]; the closure that it returns ends the search. */
  follow(since: Maybe<number>): () => void {
    this.href = LIST;
    let timer = 0;
    let left = since === null ? 0 : TRIES;
    const look = async (): Promise<void> => {
      if (left-- <= 0 || since === null) return;
      const id = await near(since);
      if (left < 0) return;
      if (id === null) timer = window.setTimeout(() => void look(), EVERY_MS);
      else this.href = `#/sessions/box/${encodeURIComponent(id)}`;
    };
    void look();
    return () => {
      left = -1;
      clearTimeout(timer);
    };
  }
}

async function near(since: number): Promise<Maybe<string>> {
  try {
    const { boxes } = await get<BoxList>('blackboxes');
    return boxes.find((box) => Math.abs(box.time - since) < NEAR_S)?.id ?? null;
  } catch (error) {
    if (!(error instanceof Problem)) throw error;
    return null;
  }
}
