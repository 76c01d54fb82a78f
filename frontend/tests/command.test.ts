import { render } from 'svelte/server';
import { beforeAll, describe, expect, it } from 'vitest';
import { message } from '../fixtures/battery';
import { makeSnapshot } from '../fixtures/snapshot';

describe('a command that cannot work', () => {
  let button: (name: string) => string;
  beforeAll(async () => {
    Object.assign(globalThis, { location: { hash: '' } });
    const { live } = await import('../src/store/live.svelte');
    const { user } = await import('../src/store/user.svelte');
    const { commands } = await import('../src/store/charging');
    const { battery } = await import('../src/store/battery.svelte');
    const { default: Command } = await import('../src/parts/Command.svelte');
    live.snapshot = makeSnapshot('drive', 0, 1000, 1);
    live.connection = 'open';
    live.now = 0;
    user.me = { role: 'engineer', name: null, password_required: false, has_chief: false };
    Object.defineProperty(battery, 'canWrite', { get: () => true });
    commands.value = {
      commands: ['charge-start', 'charge-stop'],
      block_reasons: { 'charge-start': message('not possible while driving') },
    };
    button = (name) =>
      render(Command, { props: { name, label: 'L', title: 'T', text: 'X', main: true } }).body;
  });

  it('is off and says why in words that are seen', () => {
    expect(button('charge-start')).toMatch(/<button[^>]* disabled/);
    expect(button('charge-start')).toContain('Not possible while driving');
  });

  it('is no other one', () => {
    expect(button('charge-stop')).not.toMatch(/<button[^>]* disabled/);
  });
});
