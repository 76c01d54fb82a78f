// Where a service that was never told what to read leads its reader first.

import { get, Problem } from '../link/rest';
import type { Setup } from '../link/types';

/** Open the page of the first steps where nothing was chosen yet. */
export async function firstSteps(): Promise<void> {
  try {
    const { needed } = await get<Setup>('setup');
    if (needed && !location.hash) location.hash = '#/setup';
  } catch (error) {
    if (!(error instanceof Problem)) throw error; // the overview says what is wrong
  }
}
