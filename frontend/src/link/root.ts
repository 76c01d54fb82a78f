// Where the pages of the battery shown are: `/` of the first one, `/beside/NAME/` of each other.

export const rootOf = (pathname: string): string => /^\/beside\/[^/]+\//.exec(pathname)?.[0] ?? '/';

export const ROOT = typeof location === 'undefined' ? '/' : rootOf(location.pathname);
