// Another choice of what is read: the service starts again with it, and so does this page.

import { get, Problem, call } from '../link/rest';
import type { Setup } from '../link/types';

const AGAIN_MS = 500;

/** Choose, wait until the service has started again, and open a page of it. */
export async function startAgain(
  choice: { battery: string; serial: string | null; can: string | null },
  page: string,
): Promise<void> {
  const before = await call<Setup>('setup', { method: 'PUT', body: choice });
  let now = before;
  while (now.instance === before.instance) {
    await new Promise((go) => setTimeout(go, AGAIN_MS));
    try {
      now = await get<Setup>('setup');
    } catch (error) {
      if (!(error instanceof Problem)) throw error; // it is starting
    }
  }
  location.hash = page;
  location.reload();
}

// The first page of a service without a configured connection.
/** Open the page of the first steps where nothing was chosen yet. */
export async function firstSteps(): Promise<void> {
  try {
    const { needed } = await get<Setup>('setup');
    if (needed && !location.hash) location.hash = '#/setup';
  } catch (error) {
    if (!(error instanceof Problem)) throw error; // the overview says what is wrong
  }
}
