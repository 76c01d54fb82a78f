import { beforeAll, describe, expect, it } from 'vitest';

describe('addresses', () => {
  let parse: typeof import('../src/store/route.svelte').parseHash;
  beforeAll(async () => {
    Object.assign(globalThis, { location: { hash: '' } });
    parse = (await import('../src/store/route.svelte')).parseHash;
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

  it('leads to the overview from anywhere unknown', () => {
    for (const hash of ['', '#', '#/', '#/nowhere', 'overview']) expect(parse(hash).page).toBe('overview');
  });
});
