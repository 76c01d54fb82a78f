import { svelte } from '@sveltejs/vite-plugin-svelte';
import { defineConfig } from 'vitest/config';
import { fixtureServer } from './fixtures/server.ts';
import { serviceWorker } from './service_worker.ts';

export default defineConfig(({ mode }) => ({
  base: './',
  plugins: [svelte(), serviceWorker(), ...(mode === 'fixtures' ? [fixtureServer()] : [])],
  define: { __FIXTURES__: JSON.stringify(mode === 'fixtures') },
  build: {
    outDir: '../app/static',
    emptyOutDir: true,
    target: 'es2022',
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    cssCodeSplit: false, // one small style sheet: nothing is asked for twice, and a page opens with its style
    rolldownOptions: {
      input: ['index.html', 'fleet.html'],
      output: {
        codeSplitting: {
          groups: [
            { name: 'libraries', test: /node_modules/ },
            {
              debugName: 'words',
              name: (id) => `words-${/words[\\/](\w+)[\\/]/.exec(id)![1]!}`,
              test: /app[\\/]words[\\/]/,
            },
            {
              name: 'shared',
              test: /src[\\/](link|store|theme|charts|format|words[\\/](words|render))/,
              minShareCount: 2,
            },
            {
              name: 'parts',
              test: /src[\\/]parts[\\/](AgeTag|AlarmRow|CellLink|CellMap|HeatMap|Map|Icon|Plausibility|Shape|Value)/,
            },
          ],
        },
      },
    },
  },
  server: {
    fs: { allow: ['..'] }, // the tables of app/words
    ...(mode === 'fixtures' ? {} : { proxy: { '/api': { target: 'http://127.0.0.1:8000', ws: true } } }),
  },
  resolve: mode === 'test' ? { conditions: ['browser'] } : {},
  test: { include: ['tests/**/*.test.ts'], environment: 'node', isolate: false },
}));
