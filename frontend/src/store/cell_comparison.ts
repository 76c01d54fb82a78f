// How one cell compares with the others, in a sentence each for SOC, resistance and busbar joint.

import { cellName, fixed, percent } from '../format';
import { type Shape, shapes } from './shape.svelte';
import { t } from '../words/words.svelte';
import type { Cells } from '../link/types';

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
  if (soc === null || sigma === null || middle === null) return t('packs.soc_unknown');
  const points = percent(Math.abs(soc - middle), 1);
  const n = all.length;
  if (Math.abs(soc - middle) <= sigma) return t('packs.soc_normal');
  if (soc > middle) return t('packs.soc_points_above_median', { points });
  return all.some((other) => other < soc)
    ? t('packs.soc_points_below_median', { points })
    : t('packs.lowest_soc_points_below_median', { n, points });
}

/** R0 against the mean of the adjacent cells. */
function resistanceWords(cells: Cells, index: number, neighbours: readonly number[]): string {
  const own = cells.resistance_ohm[index] ?? null;
  const adjacent = known(neighbours.map((cell) => cells.resistance_ohm[cell] ?? null));
  if (own === null || adjacent.length === 0) return t('packs.r0_unknown_until_under_load');
  const more = (own - adjacent.reduce((sum, ohm) => sum + ohm, 0) / adjacent.length) * 1000;
  const mohm = fixed(Math.abs(more), 2);
  if (mohm === fixed(0, 2)) return t('packs.r0_normal');
  return more > 0 ? t('packs.r0_m_above_neighbours', { mohm }) : t('packs.r0_m_below_neighbours', { mohm });
}

function jointWords(cells: Cells, index: number): string {
  if (cells.joint_loose[index] === true) return t('packs.high_resistance_busbar_joint');
  return (cells.joint_excess_ohm[index] ?? null) === null
    ? t('packs.busbar_joint_not_yet_assessed')
    : t('packs.busbar_joint_normal');
}

/** Return how cell `index` compares; `neighbours` are the adjacent cells in the string. */
export function comparison(cells: Cells, index: number, neighbours: readonly number[]): string {
  if ((cells.voltage_v[index] ?? null) === null) return t('packs.no_voltage_reading');
  const parts = [
    chargeWords(cells, index),
    resistanceWords(cells, index, neighbours),
    jointWords(cells, index),
  ];
  const sentences = parts.map((part) => `${part[0]!.toUpperCase()}${part.slice(1)}.`);
  if (cells.model_valid[index] === false) sentences.push(t('packs.model_does_not_fit_cell'));
  return sentences.join(' ');
}

// Words for the place of a cell on the map, and for its temperature sensor.
const SHOWN = 4;

/** "upper pack row, column 2; lower cell row, column 1", by numbers where there are more than two rows. */
export function placeOf(cell: number): string {
  const shape = shapes.here;
  const { packRow, packColumn, cellRow, cellColumn } = shape.seat(cell);
  const rows = Math.max(shape.rows.length, shape.cellRows(shape.place(cell)?.pack ?? 0).length);
  if (rows > 2)
    return t('packs.pack_row_column_cell_row_lower', {
      packRow,
      packColumn,
      cellRow,
      cellColumn,
    });
  const named = (row: number): string => (row === 1 ? t('packs.upper') : t('packs.lower'));
  return t('packs.pack_row_column_cell_row', {
    packRow: named(packRow),
    packColumn,
    cellRow: named(cellRow),
    cellColumn,
  });
}

/** Which sensor measures the temperature of a cell, and which other cells share it. */
export function sensorText(shape: Shape, cell: number): string {
  const sensors = shape.sensors(cell);
  if (!sensors.length) return t('packs.no_temperature_sensor');
  const others = shape.sharesSensor(cell);
  if (sensors.length > 1) return t('packs.hottest_of_sensors', { n: sensors.length });
  if (!others.length) return t('packs.own_temperature_sensor');
  return t('packs.sensor_also_for', {
    n: sensors[0]! + 1,
    cells:
      others.length > SHOWN
        ? t('packs.other_cells_title', { n: others.length })
        : others.map((each) => cellName(each, shape)).join('; '),
  });
}
