// Starts the stores and mounts the application.

import { mount } from 'svelte';
import './theme/tokens.css';
import './theme/base.css';
import App from './App.svelte';
import { live } from './store/live.svelte';
import { route } from './store/route.svelte';
import { chosen } from './words/words.svelte';
import { user } from './store/user.svelte';

route.start();
void user.start();
live.start();

await chosen.start();
mount(App, { target: document.getElementById('app')! });
