import { beforeEach, describe, expect, it, vi } from 'vitest';

/** A browser that keeps what it is given, and the walk-through as a page loaded anew has it. */
const kept = new Map<string, string>();
async function loaded(): Promise<typeof import('../src/store/tour.svelte')> {
  vi.resetModules();
  return import('../src/store/tour.svelte');
}

describe('the first five minutes', () => {
  beforeEach(() => {
    kept.clear();
    vi.stubGlobal('localStorage', {
      getItem: (key: string) => kept.get(key) ?? null,
      setItem: (key: string, value: string) => kept.set(key, value),
    });
    vi.stubGlobal('location', { hash: '' });
  });

  it('are offered until they were walked, and lead through pages', async () => {
    const { tour, STEPS } = await loaded();
    expect(tour.isOffered).toBe(true);
    for (let i = 0; i < STEPS.length; i++) {
      tour.go(i);
      expect(location.hash).toBe(`#/${STEPS[i]!.page}`);
    }
    tour.go(STEPS.length);
    expect(tour.step).toBeNull();
    expect(tour.isOffered).toBe(false);
  });

  it('stay skipped after a reload, and can be started again', async () => {
    (await loaded()).tour.end();
    const { tour } = await loaded();
    expect(tour.isOffered).toBe(false);
    tour.go(0);
    expect(tour.step).not.toBeNull();
  });
});
