// What the packs page can show for each cell: where the number comes from, how it is written and coloured.

import type { Accumulator, Cells, LastKnown, Part, Snapshot } from '../link/types';
import { fixed } from '../format';
import { t, type Text } from '../words/words.svelte';

export type MetricId =
  | 'voltage'
  | 'deviation'
  | 'temperature'
  | 'soc'
  | 'sigma'
  | 'resistance'
  | 'joint'
  | 'capacity'
  | 'health'
  | 'balancing';

export interface Metric {
  id: MetricId;
  name: Text;
  unit: string;
  decimals: number;
  least: number; // narrowest colour scale, in the shown unit
  diverging: boolean;
  part: Part;
  values: (snapshot: Snapshot) => (number | null)[];
  last: (known: LastKnown) => (number | null)[]; // of cells that are not measured now; nothing where none is kept
}

const times = (values: (number | null)[], factor: number): (number | null)[] =>
  values.map((v) => (v === null ? null : v * factor));

const column =
  (key: Exclude<keyof Cells, 'balancing' | 'model_valid' | 'joint_loose' | 'voltage_age_s'>, factor = 1) =>
  (s: Snapshot): (number | null)[] =>
    factor === 1 ? s.cells[key] : times(s.cells[key], factor);

/** Mean of the cells that are measured: what one of them deviates from. */
export function meanOfMeasured(values: readonly (number | null)[]): number | null {
  const known = values.filter((v) => v !== null);
  return known.length ? known.reduce((a, b) => a + b, 0) / known.length : null;
}

/** Highest minus lowest of the cells that are measured [mV]: the spread is at least this. */
export const leastDelta = (a: Accumulator | undefined): number | null =>
  a?.voltage_min_v == null || a.voltage_max_v === null ? null : (a.voltage_max_v - a.voltage_min_v) * 1000;

function deviation(s: Snapshot): (number | null)[] {
  const mean = meanOfMeasured(s.cells.voltage_v);
  return s.cells.voltage_v.map((v) => (v === null || mean === null ? null : (v - mean) * 1000));
}

const SAME_S = 1;

/** Of cells that are not measured now, from the mean of the moment when they were: of all, or of those that went. */
function lastDeviation({ cells, accumulator }: LastKnown): (number | null)[] {
  const last = cells.voltage_v;
  if (!last) return [];
  const timeOf = (i: number): number => last.times?.[i] ?? last.time;
  const newest = Math.max(...last.values.map((v, i) => (v === null ? -Infinity : timeOf(i))));
  const whole = accumulator.voltage_mean_v;
  const went = accumulator.voltage_max_v // else others are still measured
    ? meanOfMeasured(last.values.filter((_, i) => newest - timeOf(i) < SAME_S))
    : null;
  return last.values.map((v, i) => {
    if (v === null) return null;
    const isWhole = whole && Math.abs(whole.time - timeOf(i)) < SAME_S;
    const mean = isWhole ? whole.value : newest - timeOf(i) < SAME_S ? went : null;
    return mean === null ? null : (v - mean) * 1000;
  });
}

const lastColumn =
  (name: keyof LastKnown['cells'], factor = 1): Metric['last'] =>
  (known) =>
    times(known.cells[name]?.values ?? [], factor);

const metric = (
  id: MetricId,
  name: Text,
  unit: string,
  decimals: number,
  least: number,
  part: Part,
  values: Metric['values'],
  last: Metric['last'] = () => [],
): Metric => ({ id, name, unit, decimals, least, part, values, last, diverging: id === 'deviation' });

export const METRICS: readonly Metric[] = [
  metric('voltage', 'common.voltage', 'V', 3, 0.02, 'voltage', column('voltage_v'), lastColumn('voltage_v')),
  metric('deviation', 'common.deviation', 'mV', 0, 20, 'voltage', deviation, lastDeviation),
  metric(
    'temperature',
    'common.temperature',
    '°C',
    0,
    4,
    'temperature',
    column('temperature_degc'),
    lastColumn('temperature_degc'),
  ),
  metric('soc', 'common.soc', '%', 1, 2, 'voltage', column('soc', 100), lastColumn('soc', 100)),
  metric('sigma', 'common.soc_uncertainty_1sigma', '%', 2, 0.5, 'voltage', column('soc_sigma', 100)),
  metric('resistance', 'common.r0', 'mΩ', 2, 0.2, 'voltage', column('resistance_ohm', 1000)),
  metric('joint', 'common.busbar_joint', 'mΩ', 2, 0.2, 'voltage', column('joint_excess_ohm', 1000)),
  metric('capacity', 'common.capacity', 'Ah', 2, 0.5, 'voltage', column('capacity_ah')),
  metric('health', 'common.soh', '%', 1, 2, 'voltage', column('soh_capacity', 100)),
  metric('balancing', 'common.balancing', '', 0, 1, 'slaves', (s) =>
    s.cells.balancing.map((b) => (b === null ? null : Number(b))),
  ),
];

export const metricById = (id: string): Metric => METRICS.find((m) => m.id === id) ?? METRICS[0]!;

export function metricText(metric: Metric, value: number | null): string {
  if (metric.id === 'balancing')
    return value === null ? fixed(null, 0) : value ? t('common.balancing_2') : t('common.off');
  return fixed(value, metric.decimals);
}

// The share of the cells a battery reports at one instant: joints, leaks and capacity are checked from 40 % on, as
// cells of other instants carried other currents.
export const AT_ONCE = 0.4; // AT_ONCE of app/estimation/health/cell_watch.py
const TOGETHER_S = 0.15;

/** The largest share of cells whose voltages are of one instant, by the ages of all; 1 where no ages are known. */
export function simultaneousShare(ages_s: readonly (number | null)[] | null | undefined): number {
  if (!ages_s?.length) return 1;
  const known = ages_s.filter((each) => each !== null).sort((a, b) => a - b);
  let most = 0;
  for (let first = 0, last = 0; last < known.length; last++) {
    while (known[last]! - known[first]! > TOGETHER_S) first++;
    most = Math.max(most, last - first + 1);
  }
  return most / ages_s.length;
}
