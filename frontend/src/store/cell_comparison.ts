// How one cell compares with the others, in one sentence, and what of that can be said at all.

import { fixed, percent } from '../format';
import type { Cells } from '../link/types';
import { t } from '../words/words.svelte';

type Values = readonly (number | null)[] | undefined;

const known = (values: Values): number[] => (values ?? []).filter((v): v is number => v !== null);

function median(values: readonly number[]): number | null {
  const sorted = [...values].sort((a, b) => a - b);
  const middle = sorted.length >>> 1;
  if (sorted.length === 0) return null;
  return sorted.length % 2 ? sorted[middle]! : (sorted[middle - 1]! + sorted[middle]!) / 2;
}

/** SOC against the median of all: its rank where it is the lowest, nothing where sigma is larger than what differs. */
function chargeWords(cells: Cells, index: number): string {
  const soc = cells.soc[index] ?? null;
  const sigma = cells.soc_sigma[index] ?? null;
  const all = known(cells.soc);
  const middle = median(all);
  if (soc === null || sigma === null || middle === null) return t('SOC not known');
  const points = percent(Math.abs(soc - middle), 1);
  const n = all.length;
  if (Math.abs(soc - middle) <= sigma) return t('SOC like the other {n}', { n: n - 1 });
  if (soc > middle) return t('SOC {points} points above the median', { points });
  return all.some((other) => other < soc)
    ? t('SOC {points} points below the median', { points })
    : t('lowest SOC of {n}, {points} points below the median', { n, points });
}

/** R0 against the mean of the cells beside it. */
function resistanceWords(cells: Cells, index: number, neighbours: readonly number[]): string {
  const own = cells.resistance_ohm[index] ?? null;
  const beside = known(neighbours.map((cell) => cells.resistance_ohm[cell] ?? null));
  if (own === null || beside.length === 0) return t('R0 not known before it has been under load');
  const more = (own - beside.reduce((sum, ohm) => sum + ohm, 0) / beside.length) * 1000;
  const mohm = fixed(Math.abs(more), 2);
  if (mohm === fixed(0, 2)) return t('R0 like its neighbours');
  return more > 0
    ? t('R0 {mohm} mΩ more than its neighbours', { mohm })
    : t('R0 {mohm} mΩ less than its neighbours', { mohm });
}

function jointWords(cells: Cells, index: number): string {
  if (cells.joint_loose[index] === true) return t('its joint is loose');
  return (cells.joint_excess_ohm[index] ?? null) === null
    ? t('its joint is not judged yet')
    : t('its joint is sound');
}

/** Return how cell `index` compares; `neighbours` are those beside it in the string. */
export function comparison(cells: Cells, index: number, neighbours: readonly number[]): string {
  if ((cells.voltage_v[index] ?? null) === null) return t('Not measured now.');
  const words = [
    chargeWords(cells, index),
    resistanceWords(cells, index, neighbours),
    jointWords(cells, index),
  ];
  const sentence = `${words.join('; ')}.`;
  const doubt =
    cells.model_valid[index] === false ? ` ${t('The model does not follow this cell: doubt its SOC.')}` : '';
  return sentence[0]!.toUpperCase() + sentence.slice(1) + doubt;
}
