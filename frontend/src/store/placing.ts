// Words for the place of a cell on the map, and for its temperature sensor.

import { cellName } from '../format';
import type { Shape } from './shape';
import { shapes } from './shapes.svelte';
import { t } from '../words/words.svelte';

const SHOWN = 4;

/** "upper pack row, column 2; lower cell row, column 1", by numbers where there are more than two rows. */
export function placeOf(cell: number): string {
  const shape = shapes.here;
  const { packRow, packColumn, cellRow, cellColumn } = shape.seat(cell);
  const rows = Math.max(shape.rows.length, shape.cellRows(shape.place(cell)?.segment ?? 0).length);
  if (rows > 2)
    return t('pack row {packRow}, column {packColumn}; cell row {cellRow}, column {cellColumn}', {
      packRow,
      packColumn,
      cellRow,
      cellColumn,
    });
  const named = (row: number): string => (row === 1 ? t('upper') : t('lower'));
  return t('{packRow} pack row, column {packColumn}; {cellRow} cell row, column {cellColumn}', {
    packRow: named(packRow),
    packColumn,
    cellRow: named(cellRow),
    cellColumn,
  });
}

/** Which sensor tells the temperature of a cell, and which other cells it stands for. */
export function sensorText(shape: Shape, cell: number): string {
  const sensors = shape.sensors(cell);
  if (!sensors.length) return t('no temperature sensor');
  const others = shape.sharesSensor(cell);
  if (sensors.length > 1) return t('hottest of {n} sensors', { n: sensors.length });
  if (!others.length) return t('a temperature sensor of its own');
  return t('sensor {n}, also for {cells}', {
    n: sensors[0]! + 1,
    cells:
      others.length > SHOWN
        ? t('{n} other cells', { n: others.length })
        : others.map((each) => cellName(each, shape)).join('; '),
  });
}
