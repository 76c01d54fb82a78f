// The commands there are, and why the service would refuse some now.

import type { Commands } from '../link/types';
import { Asked } from './asked.svelte';

export const commands = new Asked<Commands>();
