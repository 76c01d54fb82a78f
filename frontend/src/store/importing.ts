// The form of an import: which column is what, in which unit, and which cells are taken.

import type { Column, ImportMapping } from '../link/types';
import { DASH, MINUS } from '../format';
import type { Text } from '../words/words.svelte';

export const QUANTITIES = [
  { id: 'time', field: 'time', name: 'common.time', units: ['s', 'ms', 'us', 'min', 'h'] },
  { id: 'current', field: 'current', name: 'common.current', units: ['A', 'mA', '0.1A'] },
  { id: 'voltage', field: 'voltages', name: 'common.cell_voltages', units: ['V', 'mV', '0.1mV'] },
  {
    id: 'temperature',
    field: 'temperatures',
    name: 'common.temperatures',
    units: ['degC', 'K', 'degF', '0.1degC', 'mdegC'],
  },
  { id: 'soc', field: 'soc', name: 'common.soc', units: ['percent', 'fraction'] },
] as const satisfies readonly {
  id: string;
  field: keyof ImportMapping;
  name: Text;
  units: readonly string[];
}[];

export type Quantity = (typeof QUANTITIES)[number]['id'];
export const unitOf = (quantity: Quantity): `${Quantity}_unit` => `${quantity}_unit`;

/** The profile with the units of some quantities as the service picked them. */
export function withUnits(
  profile: ImportMapping,
  found: ImportMapping,
  picked: Iterable<Quantity>,
): ImportMapping {
  const units = Object.fromEntries([...picked].map((each) => [unitOf(each), found[unitOf(each)]]));
  return { ...profile, ...units };
}

/** Numbers from 1 as the service reads them, "1-12, 14"; empty where all are taken. */
export function spans(taken: readonly boolean[]): string {
  const found: string[] = [];
  for (let first = taken.indexOf(true); first >= 0; first = taken.indexOf(true, first)) {
    const end = taken.indexOf(false, first);
    const last = end < 0 ? taken.length : end;
    found.push(last - first > 1 ? `${first + 1}-${last}` : `${first + 1}`);
    first = last;
  }
  return taken.every(Boolean) ? '' : found.join(', ');
}

/** Which of the cells a text like "1-12, 14" takes; all of them where it is empty or cannot be read. */
export function takenOf(cells: string, count: number): boolean[] {
  const found = cells.split(',').map((part) => /^\s*(\d+)\s*(?:-\s*(\d+)\s*)?$/.exec(part));
  if (!found.every((each) => each !== null)) return Array<boolean>(count).fill(true);
  return Array.from({ length: count }, (_, i) =>
    found.some(([, first, last]) => Number(first) <= i + 1 && i + 1 <= Number(last ?? first)),
  );
}

/** Some cells with one of them taken or left out; the last one stays. */
export function toggled(taken: readonly boolean[], index: number): boolean[] {
  const next = taken.map((each, i) => (i === index ? !each : each));
  return next.includes(true) ? next : [...taken];
}

/** The first values of a column, as short as possible. */
export const samplesText = (column: Pick<Column, 'samples'>): string =>
  column.samples.map((value) => (value === null ? DASH : sample(value))).join(' · ');

function sample(value: number): string {
  const text = String(Number.isInteger(value) ? value : Number(value.toPrecision(6)));
  return text.replace('-', MINUS);
}

/** The columns that a name, or a pattern with {n} and {p}, stands for; a number from 1 counts them. */
export function fits(named: string, columns: readonly Column[]): Column[] {
  const whole = columns.filter((each) => each.name === named);
  if (whole.length) return whole;
  if (/^\d+$/.test(named)) return columns.slice(Number(named) - 1, Number(named) || 0);
  if (!/\{[np]\}/.test(named)) return [];
  const parts = named.split(/\{[np]\}/).map((part) => part.replace(/[.*+?^${}()|[\]\\]/g, '\\$&'));
  const pattern = new RegExp(`^${parts.join('\\d+')}$`);
  return columns.filter((each) => pattern.test(each.name));
}
