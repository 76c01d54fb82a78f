// Writes the service worker: it keeps the pages' own files, so that they open without the service, and never an answer
// of the service. Its name for the cache is a hash of the files, so a new build replaces the old one as a whole.

import { createHash } from 'node:crypto';
import { readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import type { Plugin } from 'vite';

const worker = (cache: string, files: readonly string[]): string => `
const CACHE = '${cache}';
const FILES = ${JSON.stringify(files)};

addEventListener('install', (event) => {
  event.waitUntil(caches.open(CACHE).then((cache) => cache.addAll(FILES)).then(() => skipWaiting()));
});

addEventListener('activate', (event) => {
  const others = caches.keys().then((names) =>
    Promise.all(names.filter((n) => n.startsWith('voltwall-') && n !== CACHE).map((n) => caches.delete(n))),
  );
  event.waitUntil(others.then(() => clients.claim()));
});

addEventListener('fetch', (event) => {
  const { request } = event;
  const url = new URL(request.url);
  if (request.method !== 'GET' || url.origin !== location.origin) return;
  if (/^\\/(api\\/|metrics$)/.test(url.pathname)) return;
  const kept = (what) => caches.open(CACHE).then((cache) => cache.match(what));
  if (request.mode === 'navigate') {
    event.respondWith(fetch(request).catch(() => kept('./index.html').then((page) => page ?? Response.error())));
  } else {
    event.respondWith(kept(request).then((file) => file ?? fetch(request)));
  }
});
`;

/** Adds sw.js to the build, naming every file of it. */
export function serviceWorker(): Plugin {
  return {
    name: 'service-worker',
    apply: 'build',
    generateBundle(_, bundle) {
      const folder = join(import.meta.dirname, 'public');
      const own = readdirSync(folder).filter((name) => /\.(svg|png|webmanifest|js)$/.test(name));
      const files = ['index.html', ...own, ...Object.keys(bundle)]
        .filter((f, i, all) => all.indexOf(f) === i)
        .sort();
      const hash = createHash('sha256');
      for (const name of files) {
        const made = bundle[name];
        hash.update(name);
        if (made) hash.update(made.type === 'chunk' ? made.code : made.source);
        else if (own.includes(name)) hash.update(readFileSync(join(folder, name)));
      }
      const source = worker(
        `voltwall-${hash.digest('hex').slice(0, 12)}`,
        files.map((f) => `./${f}`),
      );
      this.emitFile({ type: 'asset', fileName: 'sw.js', source });
    },
  };
}
