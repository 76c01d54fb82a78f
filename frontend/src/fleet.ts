// The page of several cars, which `serve --fleet` answers with: it receives no car itself, it asks the service.

import { mount } from 'svelte';
import './theme/tokens.css';
import './theme/base.css';
import './theme/controls.css';
import Fleet from './views/Fleet.svelte';
import { fleet } from './store/fleet.svelte';
import { user } from './store/user.svelte';
import { chosen } from './words/words.svelte';

await chosen.start();
await user.start();
fleet.start();
const target = document.getElementById('app')!;
target.replaceChildren();
mount(Fleet, { target });
