// Takes a file from the service: a refusal is said on the page instead of being downloaded.

import { saveAs } from './clipboard';
import { t } from '../words/words.svelte';

/** Download what an address answers; returns what went wrong, or an empty text. */
export async function download(address: string, fallbackName: string): Promise<string> {
  let answer: Response;
  let file: Blob;
  try {
    answer = await fetch(address, { cache: 'no-store' });
    file = await answer.blob();
  } catch {
    return t('The service does not answer.');
  }
  if (!answer.ok) return (JSON.parse(await file.text()) as { detail?: string }).detail ?? answer.statusText;
  const named = /filename="([^"]+)"/.exec(answer.headers.get('content-disposition') ?? '')?.[1];
  saveAs(file, named ?? fallbackName);
  return '';
}
