// Another choice of what is read: the service starts again with it, and so does this page.

import { get, Problem, call } from '../link/rest';
import type { ChosenConnections, Setup } from '../link/types';

const AGAIN_MS = 500;

/** Choose, wait until the service has started again where it has to, and open a page of it. */
export async function startAgain(
  choice: { battery: string; serial: string | null; can: string | null },
  page: string,
): Promise<void> {
  const before = await call<ChosenConnections>('setup', { method: 'PUT', body: choice });
  if (!before.restarts) {
    location.hash = page;
    return;
  }
  let now: Setup = before;
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
