// Single keys that act from anywhere. They can be switched off, and they keep out of fields and dialogs.

import type { Text } from '../words/words.svelte';
import { post } from '../link/rest';
import type { Alarm } from '../link/types';
import { cellIndex, cellNumber, packNumber } from '../format';
import { openAlarms } from './alarms.svelte';
import { alertSound } from './alert_sound.svelte';
import { Preference } from './preference.svelte';
import { live } from './live.svelte';
import { mark } from './mark.svelte';
import { sibling, route, type Page } from './route.svelte';
import { shapes } from './shape.svelte';
import { user } from './user.svelte';

export interface Shortcut {
  key: string;
  does: Text;
  act: () => void;
  /** Whether it does anything now; always, if not given. */
  can?: () => boolean;
  isPage?: boolean;
}

const go = (page: Page) => (): void => {
  location.hash = `#/${page}`;
};

const isAtCells = (): boolean => route.here.page === 'packs';

/** Open the cell before or after the one that is open, wherever packs are shown. */
function step(by: number): void {
  const [pack, cell] = route.here.args.map(Number);
  if (!isAtCells()) return;
  const { nCells } = shapes.live;
  const now = (pack && cell ? cellIndex(pack, cell) : null) ?? (by > 0 ? -1 : 0);
  const next = (now + by + nCells) % nCells;
  location.hash = sibling(`packs/${packNumber(next)}/${cellNumber(next)}`, route.hash);
}

const worstUnseen = (): Alarm | undefined => openAlarms(live.snapshot).find((a) => !a.acknowledged_by);

function acknowledgeWorst(): void {
  const first = worstUnseen();
  if (first && user.me?.role && live.answers)
    void post(`alarms/${first.id}/acknowledge`).catch(() => undefined);
}

function fullScreen(): void {
  if (document.fullscreenElement) void document.exitFullscreen();
  else void document.documentElement.requestFullscreen();
}

export const SHORTCUTS: readonly Shortcut[] = [
  { key: '1', does: 'common.overview', act: go('overview'), isPage: true },
  { key: '2', does: 'common.packs', act: go('packs'), isPage: true },
  { key: '3', does: 'common.charging', act: go('charging'), isPage: true },
  { key: '4', does: 'common.parameters', act: go('parameters'), isPage: true },
  { key: '5', does: 'common.can', act: go('can'), isPage: true },
  { key: '6', does: 'common.sessions', act: go('sessions'), isPage: true },
  { key: '7', does: 'common.events', act: go('events'), isPage: true },
  { key: '8', does: 'common.system', act: go('system'), isPage: true },
  { key: '9', does: 'common.help', act: go('help'), isPage: true },
  { key: 'j', does: 'common.judge_view', act: go('judge'), isPage: true },
  { key: 'f', does: 'common.full_screen', act: fullScreen },
  {
    key: 'a',
    does: 'keys.acknowledge_worst_alarm',
    act: acknowledgeWorst,
    can: () => !!(worstUnseen() && user.me?.role),
  },
  {
    key: 'm',
    does: 'keys.mute_sound_5_minutes_unmute',
    act: () => alertSound.mute(alertSound.mutedUntil ? 0 : 5),
    can: () => alertSound.sound.value,
  },
  {
    key: 'k',
    does: 'common.mark_this_moment',
    act: () => mark.begin(),
    can: () => user.mayWrite && !!live.snapshot?.recording,
  },
  { key: '[', does: 'keys.previous_cell', act: () => step(-1), can: isAtCells },
  { key: ']', does: 'keys.next_cell', act: () => step(1), can: isAtCells },
  {
    key: 't',
    does: 'keys.next_theme',
    act: () => user.nextTheme(),
  },
  {
    key: '/',
    does: 'common.find_page_cell_session_parameter',
    act: () => keys.openPalette(),
    can: () => false, // it is open
  },
];

/** Opens the palette from fields too; on a Mac it is Cmd. */
export const PALETTE_KEY = 'Ctrl K';

class Keys {
  readonly on = new Preference<boolean>('keys', true);
  list = $state(false);
  palette = $state(false);

  start(): void {
    addEventListener('keydown', (event) => this.press(event));
  }

  openPalette(): void {
    if (!user.mustLogIn && !document.querySelector('dialog[open]')) this.palette = true;
  }

  private press(event: KeyboardEvent): void {
    const withK = event.key.toLowerCase() === 'k' && !event.altKey && !event.shiftKey;
    if (withK && (event.ctrlKey || event.metaKey)) {
      event.preventDefault(); // the browser's own search field
      this.openPalette();
      return;
    }
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
