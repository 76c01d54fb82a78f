import { render } from 'svelte/server';
import { afterAll, beforeAll, describe, expect, it } from 'vitest';
import { message } from '../fixtures/battery';
import { makeSnapshot } from '../fixtures/snapshot';
import type { Snapshot } from '../src/link/types';
import { hexLines } from '../src/store/data_warnings';

const DRIVING = makeSnapshot('drive', 0, 1000, 1);
const SILENT: Snapshot = { ...DRIVING, age: { ...DRIVING.age, voltage: null } };

describe('the strip over every page', () => {
  let live: typeof import('../src/store/live.svelte').live;
  let route: typeof import('../src/store/route.svelte').route;
  let strip: (hash: string) => string;
  beforeAll(async () => {
    Object.assign(globalThis, { location: { hash: '' } });
    ({ live } = await import('../src/store/live.svelte'));
    ({ route } = await import('../src/store/route.svelte'));
    const { default: StatusStrips } = await import('../src/parts/StatusStrips.svelte');
    strip = (hash) => {
      route.hash = hash;
      return render(StatusStrips).body;
    };
    live.connection = 'open';
    live.now = 0;
  });
  afterAll(() => {
    live.snapshot = null;
    live.connection = 'connecting';
    route.hash = '';
  });

  it('says that the car is silent on pages of live values', () => {
    live.snapshot = SILENT;
    for (const hash of ['#/overview', '#/packs/3/7', '#/events', '#/sessions'])
      expect(strip(hash), hash).toContain('data-testid="car-silent"');
  });

  it('says that bytes arrive which are no frame, and where they are shown', () => {
    const rs232 = { ...SILENT.links.rs232, state: 'silent' as const, bytes_per_s: 312, unframed: '56 3d 33' };
    live.snapshot = { ...SILENT, links: { ...SILENT.links, rs232 } };
    const shown = strip('#/overview');
    expect(shown).toContain(
      'RS232 receives 312 bytes per second but no valid frame. Check speed, parity and firmware.',
    );
    expect(shown).toContain('href="#/system"');
    expect(shown).not.toContain('supply');
    expect(hexLines('56 3d 33')).toEqual([`${'56 3d 33'.padEnd(48)}V=3`]);
  });

  it('does not over what was recorded', () => {
    live.snapshot = SILENT;
    for (const hash of [
      '#/sessions/run-1',
      '#/sessions/run-1/laps',
      '#/sessions/run-1?at=12',
      '#/sessions/box/b',
    ])
      expect(strip(hash), hash).not.toContain('car-silent');
  });

  it('says nothing while voltages come', () => {
    live.snapshot = DRIVING;
    expect(strip('#/overview')).not.toContain('data-testid');
  });

  it('says everywhere that the service is gone', () => {
    live.snapshot = SILENT;
    live.connection = 'lost';
    for (const hash of ['#/overview', '#/sessions/run-1']) {
      expect(strip(hash), hash).toContain('data-testid="service-lost"');
      expect(strip(hash), hash).not.toContain('car-silent');
    }
    live.connection = 'open';
  });

  it('says on every page since when nothing is recorded, and why', () => {
    live.snapshot = DRIVING;
    expect(strip('#/overview')).not.toContain('not-recording');
    live.snapshot = {
      ...DRIVING,
      not_recording: { since: 1000, reason: message('disk nearly full') },
    };
    for (const hash of ['#/overview', '#/sessions/run-1', '#/events']) {
      expect(strip(hash), hash).toContain('NOT RECORDING since');
      expect(strip(hash), hash).toContain('disk nearly full');
    }
    live.connection = 'lost'; // then it is not known
    expect(strip('#/overview')).not.toContain('not-recording');
    live.connection = 'open';
  });
});
