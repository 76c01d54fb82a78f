// How a write or a store ended, in words: also where its answer was lost and the master has to be read again.

import type { Difference, Finding } from '../link/types';
import { t } from '../words/words.svelte';

export type WriteOutcome = {
  kind: 'good' | 'bad' | 'conflict';
  title: string;
  text: string;
  difference?: Difference[];
  meanwhile?: Difference[];
  findings?: Finding[];
};

/** What the service found in force after a write that it could not verify. */
export type InForce = 'old' | 'new' | 'other' | 'unknown';

/** A write, a load or a store whose end nobody heard, until the master is heard again. */
export interface Doubt {
  what: 'writing' | 'loading' | 'storing';
  old: string; // hash of what was in force
  sinceMs: number;
}

/** What is in force after a write whose answer was lost. */
export function writeUnconfirmed(inForce: InForce): WriteOutcome {
  switch (inForce) {
    case 'old':
      return {
        kind: 'bad',
        title: t('Not written: the old configuration is in force'),
        text: t('The master was read again. Your draft is kept; writing again is safe.'),
      };
    case 'new':
      return {
        kind: 'good',
        title: t('Written: the new configuration is in force'),
        text: t('Only the answer was lost; the master was read again.'),
      };
    case 'other':
      return {
        kind: 'bad',
        title: t('Another configuration is in force'),
        text: t(
          'Neither the old one nor the new one: the master has started again, or somebody else wrote. Look at what differs from your draft.',
        ),
      };
    case 'unknown':
      return {
        kind: 'bad',
        title: t('Not known which configuration is in force'),
        text: t(
          'No answer came. The master holds the old one or the new one, never a mixture. It is read again as soon as it answers; writing again then is safe.',
        ),
      };
  }
}

export const storeUnconfirmed = (detail: string): WriteOutcome => ({
  kind: 'bad',
  title: t('Not known which configuration is stored'),
  text: `${detail}. ${t('The EEPROM holds the old one or the new one, never a mixture. It is read again as soon as the master answers.')}`,
});

/** What the EEPROM holds after a store whose answer was lost. */
export const storeResult = (differs: boolean): WriteOutcome =>
  differs
    ? {
        kind: 'bad',
        title: t('The EEPROM holds the old configuration'),
        text: t('The store did not come to its end, and left what was there before. Storing again is safe.'),
      }
    : {
        kind: 'good',
        title: t('The EEPROM holds the configuration in force'),
        text: t('Only the answer was lost; the EEPROM was read again.'),
      };
