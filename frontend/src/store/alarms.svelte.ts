// Which alarms still want a person's attention, how bad the worst of them is, and which cells tripped.

/* eslint-disable svelte/prefer-svelte-reactivity -- made again with every snapshot */
import { get, Problem } from '../link/rest';
import type { Alarm, BoxList, CellFinding, Maybe, PossibleCause, Severity, Snapshot } from '../link/types';
import { messageText, t, type Text } from '../words/words.svelte';
import { cellName, clock, quantity } from '../format';
import type { Shape } from './shape.svelte';

const RANK: Record<Severity, number> = { watch: 0, warning: 1, trip: 2 };
const MASTER = 'master-fault'; // says that the circuit is open; the other trips say what is beyond a limit

/** Alarms that are active or not yet acknowledged: what holds before what is over, worst first, newest first. */
export function openAlarms(snapshot: Maybe<Snapshot>): Alarm[] {
  return (snapshot?.alarms ?? [])
    .filter((a) => a.active || !a.acknowledged_by)
    .sort(
      (a, b) =>
        Number(b.active) - Number(a.active) || RANK[b.severity] - RANK[a.severity] || b.since - a.since,
    );
}

const NOUNS: Record<Severity, readonly [one: Text, other: Text]> = {
  trip: ['alarms.trip', 'alarms.trips'],
  warning: ['alarms.warning', 'alarms.warnings'],
  watch: ['alarms.to_watch', 'alarms.to_watch'],
};

interface Counted {
  active: boolean;
  severity: string;
  message: Alarm['message'];
}

export interface AlarmCount {
  severity: Severity;
  n: number;
  noun: string;
}

/** The condition for which a master opened the circuit. */
const openedBy = ({ active, message: { code, args } }: Counted): unknown =>
  active && code === MASTER ? (args['why'] as Maybe<Counted['message']>)?.code : undefined;

/** Those that hold, without the limit for which the circuit is open: that is one trip, not two. */
function holding(alarms: readonly Counted[]): Counted[] {
  const opened = new Set(alarms.map(openedBy));
  return alarms.filter((a) => a.active && !opened.has(a.message.code));
}

/** How many alarms of each car hold, by severity, worst first; one that ended does not count. */
export function alarmCounts(...cars: (readonly Counted[])[]): AlarmCount[] {
  const hold = cars.flatMap(holding);
  return (['trip', 'warning', 'watch'] as const).flatMap((severity) => {
    const n = hold.filter((a) => a.severity === severity).length;
    return n ? [{ severity, n, noun: t(NOUNS[severity][n === 1 ? 0 : 1]) }] : [];
  });
}

/** The counts as a text: "1 trip, 2 warnings"; empty where nothing holds. */
export const countText = (counts: readonly AlarmCount[]): string =>
  counts.map(({ n, noun }) => `${n} ${noun}`).join(', ');

/** The first of a list that is cut at `most`: every trip that holds, then the others in their order. */
export function mostImportant<A extends Counted>(alarms: readonly A[], most: number): A[] {
  const isTrip = (a: A): boolean => a.active && a.severity === 'trip';
  const trips = alarms.filter(isTrip);
  const others = alarms.filter((a) => !isTrip(a)).sort((a, b) => Number(b.active) - Number(a.active));
  return [...trips, ...others.slice(0, Math.max(0, most - trips.length))];
}

/** The trips that hold, the master's own first: it is the one that opened the circuit. */
export function activeTrips(snapshot: Maybe<Snapshot>): Alarm[] {
  return openAlarms(snapshot)
    .filter((a) => a.active && a.severity === 'trip')
    .sort((a, b) => Number(b.code === MASTER) - Number(a.code === MASTER));
}

/** What a trip says in two: that the circuit is open, which the banner's colour says too, and why. */
export function tripText({ code, message }: Alarm, shape?: Shape): [prefix: string, what: string] {
  const text = messageText(message, shape);
  const at = code === MASTER ? text.indexOf(': ') + 1 : 0;
  return at ? [text.slice(0, at + 1), text.slice(at + 1)] : ['', text];
}

/** What caused a trip; the cell that the trip itself names is not named again. */
export function causeText({ message, cell }: PossibleCause, trip: Alarm, shape?: Shape): string {
  const text = messageText(message, shape).replace(/(\d) (?=[^\d\s])/g, '$1\u00a0'); // no unit leaves its number
  const isSame = cell !== null && cellsOf(trip).join() === String(cell);
  return isSame ? text.replace(new RegExp(` \\S+ ${cellName(cell, shape)}`), '') : text;
}

/** Since when it holds, or when it ended. */
export const when = ({ since, ended, active }: Alarm): string =>
  active
    ? t('common.since', { time: clock(since) })
    : t('alarms.cleared', { time: clock(ended).slice(0, 5) });

/** Its value and, where it has one, the limit; empty where nothing was measured. */
export const withLimit = ({ value, limit, unit }: Alarm): string =>
  value === null
    ? ''
    : quantity(value, unit) + (limit === null ? '' : t('alarms.limit', { limit: quantity(limit, unit) }));

/** Every cell that an alarm is about. */
export const cellsOf = (alarm: Alarm): number[] =>
  alarm.cells.length ? alarm.cells : alarm.cell === null ? [] : [alarm.cell];

/** The cells that the trips which hold are about. */
export const trippedCells = (snapshot: Maybe<Snapshot>): ReadonlySet<number> =>
  new Set(activeTrips(snapshot).flatMap(cellsOf));

// What is known against single cells: findings of the service, which stay until evidence ends them.
/** The findings of one cell, the surest first. */
export const findingsOf = (snapshot: Maybe<Snapshot>, cell: number): CellFinding[] =>
  (snapshot?.findings ?? []).filter((each) => each.cell === cell);

/** The findings of each cell, as text. */
export function findingTexts(snapshot: Maybe<Snapshot>): ReadonlyMap<number, string> {
  const texts = new Map<number, string>();
  for (const each of snapshot?.findings ?? []) {
    const before = texts.get(each.cell);
    const text = messageText(each.message);
    texts.set(each.cell, before ? `${before}\n${text}` : text);
  }
  return texts;
}

// Where the black box of a trip is. It is complete some seconds after the trip, so it is asked for until it is there.
const LIST = '#/sessions/boxes';
const EVERY_MS = 3000;
const TRIES = 20;
const NEAR_S = 30; // a box holds what came within seconds of its first trigger

export class TripBox {
  href = $state(LIST);

  /** Look for the box of a trip at `since` [unix s]; the closure that it returns ends the search. */
  follow(since: Maybe<number>): () => void {
    this.href = LIST;
    let timer = 0;
    let left = since === null ? 0 : TRIES;
    const look = async (): Promise<void> => {
      if (left-- <= 0 || since === null) return;
      const id = await near(since);
      if (left < 0) return;
      if (id === null) timer = window.setTimeout(() => void look(), EVERY_MS);
      else this.href = `#/sessions/box/${encodeURIComponent(id)}`;
    };
    void look();
    return () => {
      left = -1;
      clearTimeout(timer);
    };
  }
}

async function near(since: number): Promise<Maybe<string>> {
  try {
    const { boxes } = await get<BoxList>('blackboxes');
    return boxes.find((box) => Math.abs(box.time - since) < NEAR_S)?.id ?? null;
  } catch (error) {
    if (!(error instanceof Problem)) throw error;
    return null;
  }
}
