// The commands there are, and why the service would refuse some now.

import type { Commands } from '../link/types';
import { Resource } from './resource.svelte';

export const commands = new Resource<Commands>();
