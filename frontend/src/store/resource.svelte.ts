// One answer of the service that a page shows: asked for when its address changes, dropped when the page goes.

import { get, Problem } from '../link/rest';

export class Resource<T> {
  value = $state.raw<T | null>(null);
  problem = $state('');
  busy = $state(false);
  private abort: AbortController | null = null;

  /** Ask for a path; the answer of an older question is dropped. */
  async read(path: string): Promise<void> {
    this.abort?.abort();
    const abort = (this.abort = new AbortController());
    this.busy = true;
    try {
      const answer = await get<T>(path, abort.signal);
      if (this.abort !== abort) return;
      this.value = answer;
      this.problem = '';
    } catch (error) {
      if (this.abort !== abort || !(error instanceof Problem)) return;
      this.problem = error.sentence;
    } finally {
      if (this.abort === abort) this.busy = false;
    }
  }

  stop(): void {
    this.abort?.abort();
    this.abort = null;
  }
}
