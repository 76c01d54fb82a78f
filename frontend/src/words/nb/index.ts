// Norwegian (bokmål): every text of the pages, and the sentences of the service by pattern.
import { CAN } from './can';
import { DEBRIEF } from './debrief';
import { HELP } from './help';
import { OVERVIEW } from './overview';
import { PACKS } from './packs';
import { PARAMETERS } from './parameters';
import { RECORDING } from './recording';
import service from './service.json';
import { SESSIONS } from './sessions';
import { SHELL } from './shell';
import { SIMULATOR } from './simulator';
import { SYSTEM } from './system';

const ALL = {
  ...SHELL,
  ...OVERVIEW,
  ...PACKS,
  ...SESSIONS,
  ...RECORDING,
  ...DEBRIEF,
  ...SYSTEM,
  ...HELP,
  ...SIMULATOR,
  ...CAN,
  ...PARAMETERS,
};

export type Words = Record<keyof typeof ALL, string>;

/** Sentences that the service composes: whole texts, and patterns of which the first that fits is taken. */
export interface Said {
  texts: Readonly<Record<string, string>>;
  patterns: readonly (readonly [RegExp, string])[]; // $1 is what the pattern found, itself translated
}

export const NB: Words = ALL;
export const SAID: Said = {
  texts: service.texts,
  patterns: service.patterns.map(([pattern, words]) => [new RegExp(`^${pattern}$`), words!] as const),
};
