import { beforeAll, describe, expect, it } from 'vitest';

describe('addresses', () => {
  let parse: typeof import('../src/store/route.svelte').parseHash;
  beforeAll(async () => {
    Object.assign(globalThis, { location: { hash: '' } });
    parse = (await import('../src/store/route.svelte')).parseHash;
  });

  it('leads to a page and its arguments', () => {
    expect(parse('#/packs/3/7')).toEqual({ page: 'packs', args: ['3', '7'] });
    expect(parse('#/judge').page).toBe('judge');
    expect(parse('#/sessions/a%20b').args).toEqual(['a b']);
  });

  it('leads to the overview from anywhere unknown', () => {
    for (const hash of ['', '#', '#/', '#/nowhere', 'overview']) expect(parse(hash).page).toBe('overview');
  });
});
