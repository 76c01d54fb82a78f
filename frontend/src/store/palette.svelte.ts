// What the command palette offers now. What cannot be done now is absent.

import { untrack } from 'svelte';
import { get, post } from '../link/rest';
import type { Schema, Session } from '../link/types';
import type { ConfigField } from '../generated/memory_map';
import { cellName, dateTime, ordinal } from '../format';
import { chosen, LANGUAGES, english, t, type Text } from '../words/words.svelte';
import { openAlarms } from './alarms.svelte';
import { battery, pagesNow } from './battery.svelte';
import { fitting, placesIn, type Entry } from './find_entry';
import { keys, SHORTCUTS } from './keys.svelte';
import { live } from './live.svelte';
import { mark } from './mark.svelte';
import { shapes } from './shape.svelte';
import { THEMES, user } from './user.svelte';

const MOST = 60; // more than anybody reads; typing narrows them
const SUBPAGES: readonly { path: string; name: Text; page: Text }[] = [
  { path: 'sessions/boxes', name: 'common.black_boxes', page: 'common.sessions' },
  { path: 'sessions/import', name: 'common.import', page: 'common.sessions' },
  { path: 'setup', name: 'common.connect_battery', page: 'common.system' },
];

/** What people look for that no page is called after: tasks of the documents, English and Norwegian. */
const KEYWORDS: Readonly<Record<string, string>> = {
  overview: 'weakest lowest hottest cell svakeste',
  can: 'DBC bus',
  sessions: 'export MoTeC CSV Parquet MDF4 laps report trip cause eksport',
  season: 'weakest trends SQL svakeste',
  system: 'phone QR code accounts password telefon',
  setup: 'DBC BMS profile connect battery adapter',
};

const go = (path: string) => (): void => {
  location.hash = `#/${path}`;
};

const unseen = (): number[] =>
  openAlarms(live.snapshot)
    .filter((a) => !a.acknowledged_by)
    .map((a) => a.id);

async function acknowledgeAll(): Promise<void> {
  for (const id of unseen()) await post(`alarms/${id}/acknowledge`);
}

/** Pages and actions; `also` holds the English, which is found in every language. */
function fixedEntries(): Entry[] {
  const list: Entry[] = [];
  const add = (id: string, name: Text, detail: string, act: Entry['act'], key = ''): void => {
    list.push({ id, name: t(name), detail, also: `${english(name)} ${KEYWORDS[id] ?? ''}`, key, act });
  };
  const keyOf = (name: Text): string => SHORTCUTS.find((s) => s.does === name)?.key ?? '';
  for (const page of pagesNow()) add(page.id, page.name, t('palette.page'), go(page.id), keyOf(page.name));
  for (const { path, name, page } of SUBPAGES) add(path, name, t(page), go(path));
  const nUnseen = user.mayWrite ? unseen().length : 0;
  if (nUnseen > 0)
    list.push({
      id: 'acknowledge-all',
      name: t('palette.acknowledge_all_alarms'),
      detail: t('palette.not_acknowledged', { n: nUnseen }),
      also: 'Acknowledge all alarms',
      waits: true,
      act: acknowledgeAll,
    });
  if (user.mayWrite && live.snapshot?.recording)
    add('lap', 'palette.mark_a_lap', '', () => mark.begin('lap'));
  for (const { key, does, act, can, isPage } of SHORTCUTS)
    if (!isPage && (can?.() ?? true)) add(`key-${key}`, does, '', act, key);
  add('keys', 'common.keyboard_shortcuts', '', () => void (keys.list = true), '?');
  for (const theme of THEMES.filter((each) => each !== user.theme))
    list.push({
      id: `theme-${theme}`,
      name: `${t('common.theme')}: ${t(`theme.${theme}`)}`,
      detail: '',
      also: `Theme ${theme}`,
      act: () => user.setTheme(theme),
    });
  for (const { id, name } of LANGUAGES.filter((each) => each.id !== chosen.language))
    list.push({
      id: `language-${id}`,
      name: `${t('common.language')}: ${name}`,
      detail: '',
      also: 'Language',
      act: () => chosen.set(id),
    });
  return list;
}

/** The same list until somebody may mark, or no longer: it does not move under the finger. */
const fixedFor = (_canMark: boolean): Entry[] => untrack(fixedEntries);

const sessionEntry = (s: Session): Entry => ({
  id: `session-${s.id}`,
  name: s.name || s.id,
  detail: `${t('common.session')} · ${dateTime(s.started)}`,
  hidden: true,
  act: go(`sessions/${encodeURIComponent(s.id)}`),
});

const parameterEntries = (schema: Schema): Entry[] =>
  schema.fields.map(({ name, meaning }) => ({
    id: `parameter-${name}`,
    name,
    detail: t(`param.${name as ConfigField}`),
    also: `${t('common.parameter')} ${meaning} ${english(`param.${name as ConfigField}`)}`,
    hidden: true,
    act: go(`parameters?find=${encodeURIComponent(name)}`),
  }));

/** The entries from the moment on at which the palette was opened. */
export class Palette {
  private readonly canMark = $derived(user.mayWrite && Boolean(live.snapshot?.recording));
  private readonly fixed = $derived.by(() => fixedFor(this.canMark)); // opened before it is known who is here, too
  private sessions = $state.raw<Entry[]>([]);
  private parameters = $state.raw<Entry[]>([]);
  private readonly all = $derived([...this.fixed, ...this.parameters, ...this.sessions]);

  /** Ask for what has a name of its own; without the service only pages and actions are offered. */
  async read(): Promise<void> {
    const sessions = get<{ sessions: Session[] }>('sessions').then((answer) => {
      this.sessions = answer.sessions.map(sessionEntry);
    });
    const parameters = battery.canWrite
      ? get<Schema>('config/schema').then((schema) => {
          this.parameters = parameterEntries(schema);
        })
      : undefined;
    await Promise.allSettled([sessions, parameters]);
  }

  find(typed: string): Entry[] {
    const shape = shapes.live;
    const names = { pack: ['pack', t('common.pack_2')], cell: ['cell', t('common.cell_2')] };
    const places = placesIn(typed, shape, names).map(({ pack, cell }): Entry => {
      if (cell === null)
        return {
          id: `pack-${pack}`,
          name: t('common.pack_lower', { n: pack }),
          detail: t('common.packs'),
          act: go(`packs/${pack}`),
        };
      const index = shape.cells(pack - 1)[cell - 1]!;
      return {
        id: `cell-${index}`,
        name: cellName(index, shape),
        detail: t('common.cell_lower', { n: ordinal(index) }),
        act: go(`packs/${pack}/${cell}`),
      };
    });
    return [...places, ...fitting(this.all, typed)].slice(0, MOST);
  }
}
