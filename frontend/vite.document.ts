// Builds document.html into one file: its script, its style and its font stand inside, so that it opens from anywhere.

import { svelte } from '@sveltejs/vite-plugin-svelte';
import { defineConfig, type Plugin } from 'vite';

/** Puts every script and style of the build into its page. */
function oneFile(): Plugin {
  return {
    name: 'one-file',
    generateBundle: {
      order: 'post', // when nothing is replaced in the script any more
      handler(_, bundle) {
        const page = Object.values(bundle).find((made) => made.fileName.endsWith('.html'));
        if (page?.type !== 'asset') throw new Error('no page was built');
        let html = String(page.source);
        for (const made of Object.values(bundle)) {
          if (made === page) continue;
          const name = made.fileName.replaceAll('.', '\\.');
          if (made.type === 'chunk') {
            const code = made.code.replaceAll('</script', '<\\/script');
            html = html.replace(new RegExp(`<script type="module"[^>]*${name}"></script>`), '');
            html = html.replace('</body>', () => `<script type="module">${code}</script></body>`);
          } else {
            html = html.replace(
              new RegExp(`<link rel="stylesheet"[^>]*${name}">`),
              () => `<style>${String(made.source)}</style>`,
            );
          }
          Reflect.deleteProperty(bundle, made.fileName);
        }
        page.source = html;
      },
    },
  };
}

export default defineConfig({
  base: './',
  publicDir: false,
  plugins: [svelte(), oneFile()],
  build: {
    outDir: '../app/static',
    emptyOutDir: false, // the pages are built before
    target: 'es2022',
    assetsInlineLimit: Number.MAX_SAFE_INTEGER, // the font too
    modulePreload: false,
    cssCodeSplit: false,
    rolldownOptions: { input: 'document.html', output: { codeSplitting: false } },
  },
});
