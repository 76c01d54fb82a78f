import { render } from 'svelte/server';
import type { Component } from 'svelte';
import { beforeAll, describe, expect, it } from 'vitest';
import { makeSnapshot } from '../fixtures/snapshot';
import type { Session, Snapshot } from '../src/link/types';

const RECORDING = { session_id: 'run-1', since: 900, frames: 10, bytes: 1000 };
const SESSION = { id: 'run-1', name: 'run 1', recording: true, closed: false, metadata: {} } as Session;

describe('of a service that is gone', () => {
  let live: typeof import('../src/store/live.svelte').live;
  let body: (file: string, props?: Record<string, unknown>) => Promise<string>;
  beforeAll(async () => {
    Object.assign(globalThis, { location: { hash: '' }, localStorage: { getItem: () => null } });
    ({ live } = await import('../src/store/live.svelte'));
    const { user } = await import('../src/store/user.svelte');
    user.me = { role: 'engineer', name: null, password_required: false, has_chief: false };
    const snapshot: Snapshot = makeSnapshot('fault', 0, 1000, 1);
    live.snapshot = { ...snapshot, recording: RECORDING };
    live.now = 0;
    const views = import.meta.glob<{ default: Component }>('../src/**/*.svelte');
    body = async (file, props = {}) => render((await views[`../src/${file}`]!()).default, { props }).body;
  });

  const both = async (file: string, props?: Record<string, unknown>): Promise<[string, string]> => {
    live.connection = 'open';
    const answering = await body(file, props);
    live.connection = 'lost';
    return [answering, await body(file, props)];
  };

  it('the state of each link is unknown, not lost', async () => {
    const [before, after] = await both('parts/TopBar.svelte');
    expect(before).not.toContain('data-state="unknown"');
    expect(after.match(/data-state="unknown"/g)).toHaveLength(3); // both links, and the car
    expect(after).not.toContain('lost');
  });

  it('no recording is shown', async () => {
    const attempt = (): Promise<void> => Promise.resolve();
    const [before, after] = await both('views/sessions/Recording.svelte', { attempt });
    expect(before).toContain('Recording run-1');
    expect(after).toContain('Recording unknown, last known: run-1');
    for (const [file, props] of [
      ['views/sessions/Recording.svelte', { attempt }],
      ['views/sessions/SessionName.svelte', { session: SESSION }],
      ['parts/TopBar.svelte', {}],
    ] as const) {
      const [recording, unknown] = await both(file, props);
      expect(recording, file).toContain('<circle cx="8" cy="8" r="6.5"');
      expect(unknown, file).not.toContain('<circle cx="8" cy="8" r="6.5"');
    }
  });

  it('no alarm can be acknowledged', async () => {
    for (const file of ['parts/AlarmList.svelte', 'parts/TripBanner.svelte']) {
      const [before, after] = await both(file);
      expect(before, file).toMatch(/Acknowledge<\/button>/);
      expect(before, file).not.toMatch(/<button[^>]* disabled/);
      expect(after, file).toMatch(/<button[^>]* disabled/);
    }
  });
});
