// A moment that somebody is about to mark: the instant counts at which the key was pressed, not when the note is written.

import type { Text } from '../words/words.svelte';
import { post } from '../link/rest';
import { live } from './live.svelte';

/** What a marker can be; laps and drivers are read out of them later. */
export const KINDS: readonly { kind: string; name: Text; key: string }[] = [
  { kind: 'note', name: 'common.note', key: 'n' },
  { kind: 'lap', name: 'common.lap', key: 'l' },
  { kind: 'driver', name: 'common.driver_change', key: 'd' },
  { kind: 'off-track', name: 'common.off_track', key: 'o' },
];

class Mark {
  /** When the key was pressed, in milliseconds of this page's clock; null while nobody marks. */
  since = $state<number | null>(null);
  kind = 'note';

  /** Note the moment; the note is written afterwards. */
  begin(kind = 'note'): void {
    if (!live.snapshot?.recording) return;
    this.kind = kind;
    this.since = performance.now();
  }

  end(): void {
    this.since = null;
  }

  /** Put a marker where the key was pressed. */
  async set(kind: string, text: string): Promise<void> {
    const session = live.snapshot?.recording?.session_id;
    if (!session) return;
    const ago = this.since === null ? 0 : (performance.now() - this.since) / 1000;
    await post(`sessions/${session}/markers`, { text, kind, ago_s: Math.min(ago, 600) });
  }
}

export const mark = new Mark();
