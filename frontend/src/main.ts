// Starts the stores and mounts the application.

import { mount } from 'svelte';
import './theme/tokens.css';
import './theme/base.css';
import './theme/controls.css';
import './theme/print.css';
import App from './App.svelte';
import { alertSound } from './store/alert_sound.svelte';
import { keys } from './store/keys.svelte';
import { live } from './store/live.svelte';
import { paper } from './store/paper.svelte';
import { route } from './store/route.svelte';
import { chosen } from './words/words.svelte';
import { user } from './store/user.svelte';

route.start();
void user.start();
live.start();
alertSound.start();
keys.start();
paper.start();
if (import.meta.env.PROD && 'serviceWorker' in navigator) {
  void navigator.serviceWorker.register('./sw.js').catch(() => undefined); // the pages work without it
}

await chosen.start();
const target = document.getElementById('app')!;
target.replaceChildren(); // the frame that index.html shows meanwhile
mount(App, { target });
