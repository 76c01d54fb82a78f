// One answer of the service that a page shows: asked for when its address changes, dropped when the page goes.

import { untrack } from 'svelte';
import { Problem, get } from '../link/rest';

export class Resource<T> {
  value = $state.raw<T | null>(null);
  problem = $state('');
  busy = $state(false);
  answers = $state(0); // how many came
  private abort: AbortController | null = null;

  /** Follow an address within a component, null asks for nothing; a first answer is not waited for, others pause. */
  constructor(path?: () => string | null, pauseMs = 0) {
    if (!path) return;
    $effect(() => {
      const wanted = path();
      if (wanted === null) return;
      const isFirst = untrack(() => this.value) === null;
      const timer = setTimeout(() => void this.read(wanted), isFirst ? 0 : pauseMs);
      return () => (clearTimeout(timer), this.stop());
    });
  }

  /** Ask for a path; the answer of an older question is dropped. */
  async read(path: string): Promise<void> {
    this.abort?.abort();
    const abort = (this.abort = new AbortController());
    this.busy = true;
    try {
      const answer = await get<T>(path, abort.signal);
      if (this.abort !== abort) return;
      this.value = answer;
      this.answers++;
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

// Something that a page asks of the service: whether it is under way, and why the last try failed.
export class Attempt {
  busy = $state(''); // what is under way
  failed = $state(''); // a sentence in the page's language, until a try succeeds

  /** Try it, and return whether it was done. */
  async run(action: () => Promise<unknown>, what = 'it'): Promise<boolean> {
    this.busy = what;
    try {
      await action();
      this.failed = '';
      return true;
    } catch (error) {
      if (!(error instanceof Problem)) throw error;
      this.failed = error.sentence;
      return false;
    } finally {
      this.busy = '';
    }
  }
}

/** Read now and every so often; return what ends it, for an effect. */
export function every(milliseconds: number, read: () => unknown): () => void {
  void read();
  const timer = setInterval(() => void read(), milliseconds);
  return () => clearInterval(timer);
}
