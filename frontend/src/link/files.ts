// Files and the clipboard: hands over text and pictures, and takes files from the service.

import { t } from '../words/words.svelte';

const KEPT_MS = 60_000; // a busy computer begins a download later than it is asked for

/** Let the browser save what was made here. */
export function saveAs(content: Blob, name: string): void {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), KEPT_MS);
}

/** Copy, or save under the name where that is refused; returns what was done, for the reader. */
export async function copy(content: Blob, name: string): Promise<string> {
  try {
    const [type] = content.type.split(';');
    await navigator.clipboard.write([new ClipboardItem({ [type!]: content })]);
    return t('common.copied');
  } catch {
    saveAs(content, name);
    return t('common.saved_as', { name });
  }
}

/** Copy CSV as plain text, which every program takes. */
export const copyCsv = (text: string, name: string): Promise<string> =>
  copy(new Blob([text], { type: 'text/plain' }), `${name}.csv`);

// Takes a file from the service: a refusal is shown on the page instead of being downloaded.
/** Download what an address answers; returns what went wrong, or an empty text. */
export async function download(address: string, fallbackName: string): Promise<string> {
  let answer: Response;
  let file: Blob;
  try {
    answer = await fetch(address, { cache: 'no-store' });
    file = await answer.blob();
  } catch {
    return t('common.service_does_not_respond');
  }
  if (!answer.ok) return (JSON.parse(await file.text()) as { detail?: string }).detail ?? answer.statusText;
  const named = /filename="([^"]+)"/.exec(answer.headers.get('content-disposition') ?? '')?.[1];
  saveAs(file, named ?? fallbackName);
  return '';
}
