// What a page shows of a quantity: what is measured now or, where nothing is, what it last was and since when. The
// last values are drawn in grey with their age; no scale, mark, sum or limit counts with them.

import { age, BLANK_S, type Freshness } from '../format';
import type {
  LastNumber,
  LastOfAccumulator,
  LastOfCells,
  LastOfPack,
  Maybe,
  Part,
  Snapshot,
} from '../link/types';
import { t } from '../words/words.svelte';
import { live } from './live.svelte';
import type { Metric } from './metrics';

/** A number to be drawn; `since` is the unix time of one that is not measured now, null of one that is. */
export interface Shown {
  value: Maybe<number>;
  since: Maybe<number>;
  cell: Maybe<number>;
  part: Part; // that it is as old as
}
export type CellQuantity = keyof LastOfCells;
export type TotalQuantity = keyof LastOfAccumulator;
export type PackQuantity = keyof LastOfPack;

const PART: Record<CellQuantity, Part> = {
  voltage_v: 'voltage',
  temperature_degc: 'temperature',
  soc: 'voltage',
};

const partOf = (name: string): Part =>
  name.includes('temperature')
    ? 'temperature'
    : name === 'current_a' || name === 'power_w'
      ? 'current'
      : 'voltage';

/** The part that a total is as old as: without cells the master's own SOC, or what it reports with its current. */
export function partOfTotal(s: Maybe<Snapshot>, name: TotalQuantity): Part {
  const part = partOf(name);
  if (!s || s.accumulator[name] === null || part !== 'voltage') return part;
  if (name === 'soc' || name === 'driver_soc_percent')
    return s.accumulator.soc_source === 'master' ? 'soc' : part;
  return s.accumulator.loaded_cells === 0 ? 'current' : part;
}

const nothing = (part: Part): Shown => ({ value: null, since: null, cell: null, part });

/** When the values of a snapshot were measured that have grown old on this page only; null where they had before. */
function agedHere(s: Snapshot, part: Part): Maybe<number> {
  const age_s = s.age[part];
  return age_s === null || age_s >= Math.max(BLANK_S, s.live_s?.[part] ?? 0) ? null : s.time - age_s;
}

/** A value of a part, else the last one. */
export function shown(
  s: Snapshot,
  fresh: Freshness,
  part: Part,
  value: Maybe<number> | undefined,
  last: Maybe<LastNumber> | undefined,
  cell: Maybe<number> = null,
): Shown {
  const there = value ?? null;
  if (fresh !== 'blank' && there !== null) return { value: there, since: null, cell, part };
  if (last) return { value: last.value, since: last.time, cell: last.cell ?? null, part };
  const since = fresh === 'blank' && there !== null ? agedHere(s, part) : null;
  return since === null ? nothing(part) : { value: there, since, cell, part };
}

/** What is known of a cell. */
export function shownCell(s: Maybe<Snapshot>, fresh: Freshness, name: CellQuantity, index: number): Shown {
  if (!s) return nothing(PART[name]);
  const last = s.last_known?.cells[name];
  const value = last?.values[index] ?? null;
  const time = last?.times?.[index] ?? last?.time;
  const known = value === null || time === undefined ? null : { value, time };
  return shown(s, fresh, PART[name], s.cells[name][index], known);
}

/** Whether nothing of a part is measured: where some cells still are, totals of before are not shown next to them. */
function isGone(fresh: Freshness, part: Part, s: Snapshot): boolean {
  const { loaded_cells, current_a, temperature_max_degc } = s.accumulator;
  if (fresh === 'blank') return true;
  if (part === 'voltage') return loaded_cells === 0;
  return (part === 'current' ? current_a : temperature_max_degc) === null;
}

/** What is known of the whole accumulator. */
export function shownTotal(s: Maybe<Snapshot>, fresh: Freshness, name: TotalQuantity): Shown {
  const part = partOfTotal(s, name);
  if (!s) return nothing(part);
  const cellOf = `${name.replace(/_(v|degc)$/, '')}_cell` as 'voltage_min_cell';
  const last = isGone(fresh, part, s) ? s.last_known?.accumulator[name] : null;
  return shown(s, fresh, part, s.accumulator[name], last, s.accumulator[cellOf] ?? null);
}

/** What is known of a pack. */
export function shownPack(s: Maybe<Snapshot>, fresh: Freshness, name: PackQuantity, index: number): Shown {
  const pack = s?.packs[index];
  const part = partOf(name);
  if (!s || !pack) return nothing(part);
  const gone = fresh === 'blank' || (part === 'voltage' ? pack.min_v : pack.temperature_max_degc) === null;
  return shown(s, fresh, part, pack[name], gone ? s.last_known?.packs[index]?.[name] : null);
}

/** Time of the oldest of the last values of a part, and of how many cells there are some; null where there are none. */
export function lastOf(s: Maybe<Snapshot>, part: Part): Maybe<{ time: number; cells: number }> {
  const known = s?.last_known;
  if (!known) return null;
  if (part === 'current') {
    const last = known.accumulator.current_a;
    return last ? { time: last.time, cells: 0 } : null;
  }
  const last =
    part === 'voltage' ? known.cells.voltage_v : part === 'temperature' ? known.cells.temperature_degc : null;
  return last ? { time: last.time, cells: last.values.filter((v) => v !== null).length } : null;
}

export const ago = (seconds: Maybe<number>): string => t('common.ago', { age: age(seconds) });

// Of the newest snapshot, as this page's clock ages it.
export const cellNow = (name: CellQuantity, index: number): Shown =>
  shownCell(live.snapshot, live.freshness(PART[name]), name, index);
export const totalNow = (name: TotalQuantity): Shown =>
  shownTotal(live.snapshot, live.freshness(partOfTotal(live.snapshot, name)), name);
export const packNow = (name: PackQuantity, index: number): Shown =>
  shownPack(live.snapshot, live.freshness(partOf(name)), name, index);

/** What a map draws in grey: of cells that are not measured now, the last of a metric. */
export function lastOfMetric(metric: Metric): Maybe<number>[] {
  const s = live.snapshot;
  if (!s) return [];
  const known = s.last_known ? metric.last(s.last_known) : [];
  if (known.length || live.freshness(metric.part) !== 'blank' || agedHere(s, metric.part) === null)
    return known;
  return metric.values(s);
}

/** How old the values of a part are where they are the last known, or those of some cells; empty where all are live. */
export function ageText(part: Part): string {
  const { snapshot } = live;
  const last = lastOf(snapshot, part);
  const seconds = live.age(part);
  if (live.freshness(part) === 'blank') {
    const known = last !== null || (snapshot !== null && agedHere(snapshot, part) !== null);
    return known && seconds !== null ? ago(seconds) : '';
  }
  if (!snapshot || !last) return '';
  const one = ago(live.since(last.time));
  const all = snapshot.cells.voltage_v.length;
  return last.cells === 0 || last.cells === all ? one : t('common.of', { n: last.cells, all, age: one });
}
