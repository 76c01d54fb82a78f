// Single keys that act from anywhere. They can be switched off, and they keep out of fields and dialogs.

import type { Text } from '../words/words.svelte';
import { post } from '../link/rest';
import { cellIndex, cellNumber, packNumber } from '../format';
import { openAlarms } from './alarms';
import { alertSound } from './alert_sound.svelte';
import { Preference } from './preference.svelte';
import { live } from './live.svelte';
import { mark } from './mark.svelte';
import { route, type Page } from './route.svelte';
import { shapes } from './shapes.svelte';
import { THEMES, user } from './user.svelte';

export interface Shortcut {
  key: string;
  does: Text;
  act: () => void;
}

const go = (page: Page) => (): void => {
  location.hash = `#/${page}`;
};

/** Open the cell before or after the one that is open, wherever packs are shown. */
function step(by: number): void {
  const [pack, cell] = route.here.args.map(Number);
  if (route.here.page !== 'packs') return;
  const { nCells } = shapes.live;
  const now = (pack && cell ? cellIndex(pack, cell) : null) ?? (by > 0 ? -1 : 0);
  const next = (now + by + nCells) % nCells;
  location.hash = `#/packs/${packNumber(next)}/${cellNumber(next)}`;
}

function acknowledgeWorst(): void {
  const first = openAlarms(live.snapshot).find((a) => !a.acknowledged_by);
  if (first && user.me?.role) void post(`alarms/${first.id}/acknowledge`).catch(() => undefined);
}

function fullScreen(): void {
  if (document.fullscreenElement) void document.exitFullscreen();
  else void document.documentElement.requestFullscreen();
}

export const SHORTCUTS: readonly Shortcut[] = [
  { key: '1', does: 'Overview', act: go('overview') },
  { key: '2', does: 'Packs', act: go('packs') },
  { key: '3', does: 'Charging', act: go('charging') },
  { key: '4', does: 'Parameters', act: go('parameters') },
  { key: '5', does: 'CAN', act: go('can') },
  { key: '6', does: 'Sessions', act: go('sessions') },
  { key: '7', does: 'Events', act: go('events') },
  { key: '8', does: 'System', act: go('system') },
  { key: '9', does: 'Help', act: go('help') },
  { key: 'j', does: 'Judge view', act: go('judge') },
  { key: 'f', does: 'Full screen', act: fullScreen },
  { key: 'a', does: 'Acknowledge the worst alarm', act: acknowledgeWorst },
  {
    key: 'm',
    does: 'Mute the sound for 5 minutes, or end it',
    act: () => alertSound.mute(alertSound.mutedUntil ? 0 : 5),
  },
  { key: 'k', does: 'Mark this moment', act: () => mark.begin() },
  { key: '[', does: 'Cell before', act: () => step(-1) },
  { key: ']', does: 'Cell after', act: () => step(1) },
  {
    key: 't',
    does: 'Next theme',
    act: () => user.setTheme(THEMES[(THEMES.indexOf(user.theme) + 1) % THEMES.length]!),
  },
];

class Keys {
  readonly on = new Preference<boolean>('keys', true);
  list = $state(false);

  start(): void {
    addEventListener('keydown', (event) => this.press(event));
  }

  private press(event: KeyboardEvent): void {
    if (event.ctrlKey || event.altKey || event.metaKey || event.defaultPrevented) return;
    const at = event.target;
    if (at instanceof HTMLElement && at.closest('input, textarea, select, dialog, [contenteditable]')) return;
    if (event.key === '?') {
      this.list = true;
      event.preventDefault();
      return;
    }
    const found = this.on.value ? SHORTCUTS.find((s) => s.key === event.key) : undefined;
    if (!found) return;
    event.preventDefault();
    found.act();
  }
}

export const keys = new Keys();
