// What an analysis says, as a sentence of the page's language.

import type { AnalysisFinding } from '../link/types';
import { MINUS } from '../format';
import { messageText } from './words.svelte';

/** A number stays beside its unit, and a minus is one. */
export const whole = (text: string): string =>
  text
    .replace(/(?<![\p{L}\d])-(?=\d)/gu, MINUS)
    .replace(/(\d) (%|A|V|Ah|mV|K|s|min|h|kWh|°C|mΩ)(?![\p{L}])/gu, '$1\u00a0$2');

/** What is said, as a sentence: it begins with a capital letter. */
export const sentence = (finding: AnalysisFinding): string =>
  capitalised(whole(messageText(finding, finding.text)));

export const capitalised = (text: string): string => text.slice(0, 1).toUpperCase() + text.slice(1);
