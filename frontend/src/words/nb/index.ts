// Norwegian (bokmål): every text of the pages, and the sentences of the service by pattern.
import { CAN } from './can';
import { DEBRIEF } from './debrief';
import { HELP } from './help';
import { OVERVIEW } from './overview';
import { PACKS } from './packs';
import { PARAMETERS } from './parameters';
import { RECORDING } from './recording';
import { SERVICE } from './service';
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
export type Said = typeof SERVICE;

export const NB: Words = ALL;
export const SAID: Said = SERVICE;
