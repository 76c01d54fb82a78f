import { render } from 'svelte/server';
import { beforeEach, describe, expect, it } from 'vitest';
import type { Session } from '../src/link/types';
import { live } from '../src/store/live.svelte';
import SessionName from '../src/views/sessions/SessionName.svelte';

/** What is read and copied: the text without its elements, and with one space where there are several. */
function text(over: Partial<Session>): string {
  const session = { id: 'a', name: 'lv14.csv', recording: false, closed: true, metadata: {}, ...over };
  const { body } = render(SessionName, { props: { session: session as Session } });
  return body
    .replace(/<!--.*?-->|<[^>]*>/gs, '')
    .replace(/\s+/g, ' ')
    .trim();
}

describe('the name of a session in the list', () => {
  beforeEach(() => Object.assign(live, { connection: 'open', now: 0 })); // whatever another test left

  it('stands alone where there is nothing to add', () => {
    expect(text({})).toBe('lv14.csv');
    expect(text({ name: '' })).toBe('a');
  });

  it('is parted from each mark behind it', () => {
    expect(text({ metadata: { imported_from: 'lv14.csv' } })).toBe('lv14.csv imported');
    expect(text({ metadata: { source: 'simulator' } })).toBe('lv14.csv simulated');
    expect(text({ metadata: { filled: 'b' } })).toBe('lv14.csv gaps filled from another recorder');
    expect(text({ closed: false })).toBe('lv14.csv not closed');
    expect(text({ closed: false, recording: true })).toBe('lv14.csv recording');
  });

  it('has marks that are parted from each other', () => {
    const metadata = { source: 'simulator', filled: 'b', imported_from: 'lv14.csv' };
    expect(text({ closed: false, metadata })).toBe(
      'lv14.csv not closed simulated gaps filled from another recorder imported',
    );
    expect(text({ recording: true, metadata: { source: 'simulator' } })).toBe('lv14.csv recording simulated');
  });
});
