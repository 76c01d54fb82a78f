import { beforeAll, describe, expect, it, vi } from 'vitest';

describe('addresses', () => {
  let parse: typeof import('../src/store/route.svelte').parseHash;
  let sibling: typeof import('../src/store/route.svelte').sibling;
  beforeAll(async () => {
    Object.assign(globalThis, { location: { hash: '' } });
    ({ parseHash: parse, sibling } = await import('../src/store/route.svelte'));
  });

  it('leads to a page and its arguments', () => {
    expect(parse('#/packs/3/7')).toMatchObject({ page: 'packs', args: ['3', '7'] });
    expect(parse('#/judge').page).toBe('judge');
    expect(parse('#/sessions/a%20b').args).toEqual(['a b']);
  });

  it('carries what is in view behind a question mark', () => {
    const place = parse('#/sessions/run-3?from=12.5&with=run%202');
    expect(place.args).toEqual(['run-3']);
    expect([place.query.get('from'), place.query.get('with')]).toEqual(['12.5', 'run 2']);
  });

  it('of the next cell keeps all that is shown but the part in view', () => {
    const here = '#/packs/1/2?sort-history=3&from-cell=10.000&to-cell=20.000&a-cell=12.000&find-x=a+b';
    expect(sibling('packs/1/3', here)).toBe('#/packs/1/3?sort-history=3&a-cell=12.000&find-x=a+b');
    expect(sibling('packs/1/3', '#/packs/1/2?from-cell=1&to-cell=2')).toBe('#/packs/1/3');
    expect(sibling('packs/1/3', '#/packs/1/2')).toBe('#/packs/1/3');
  });

  it('leads to the overview from anywhere unknown', () => {
    for (const hash of ['', '#', '#/', '#/nowhere', 'overview']) expect(parse(hash).page).toBe('overview');
    expect(parse('#/nowhere/3?a=1').unknown).toBe('#/nowhere/3');
    for (const hash of ['', '#/', '#/overview', '#/packs/%E0']) expect(parse(hash).unknown).toBeNull();
  });

  it('is not taken back by what the page that was left notes', async () => {
    const { route } = await import('../src/store/route.svelte');
    const replaceState = vi.fn((_: unknown, __: string, hash: string) => (location.hash = hash));
    Object.assign(globalThis, { history: { replaceState } });
    route.hash = location.hash = '#/sessions/run-3';
    route.note({ find: 'a b' });
    expect(route.hash).toBe('#/sessions/run-3?find=a+b');

    location.hash = '#/parameters'; // `hashchange` comes in a task of its own
    route.note({ find: 'c' });
    expect(location.hash).toBe('#/parameters');
    expect(replaceState).toHaveBeenCalledTimes(1);
  });
});
