// Where the cells sit in the car. Change these tables when the accumulator is built differently.
// Eight packs in two rows of four, cabled out and back; in a pack twelve cells in two rows of six, likewise.

import { CELLS_PER_PACK } from '../format';
import { t } from '../words/words.svelte';

/** Pack indices by row and column, seen from above. */
export const PACK_ROWS: readonly (readonly number[])[] = [
  [0, 1, 2, 3],
  [7, 6, 5, 4],
];

/** Cell positions in a pack by row and column. */
export const CELL_ROWS: readonly (readonly number[])[] = [
  [0, 1, 2, 3, 4, 5],
  [11, 10, 9, 8, 7, 6],
];

export const indexOf = (pack: number, position: number): number => pack * CELLS_PER_PACK + position;

/** The cell that lies `dx` columns and `dy` rows away in the car, null beyond its edge. */
export function besides(index: number, dx: number, dy: number): number | null {
  const pack = Math.floor(index / CELLS_PER_PACK);
  const position = index % CELLS_PER_PACK;
  const packRow = PACK_ROWS.findIndex((row) => row.includes(pack));
  const cellRow = CELL_ROWS.findIndex((row) => row.includes(position));
  const wide = CELL_ROWS[0]!.length;
  const high = CELL_ROWS.length;
  const x = PACK_ROWS[packRow]!.indexOf(pack) * wide + CELL_ROWS[cellRow]!.indexOf(position) + dx;
  const y = packRow * high + cellRow + dy;
  const found = PACK_ROWS[Math.floor(y / high)]?.[Math.floor(x / wide)];
  if (found === undefined) return null;
  return indexOf(found, CELL_ROWS[y % high]![x % wide]!);
}

/** Words for the place of a cell: "front row, second from the left". */
export function placeOf(index: number): string {
  const pack = Math.floor(index / CELLS_PER_PACK);
  const position = index % CELLS_PER_PACK;
  const packRow = PACK_ROWS.findIndex((row) => row.includes(pack));
  const packColumn = PACK_ROWS[packRow]!.indexOf(pack) + 1;
  const cellRow = CELL_ROWS.findIndex((row) => row.includes(position));
  const cellColumn = CELL_ROWS[cellRow]!.indexOf(position) + 1;
  const rowName = (row: number): string => (row === 0 ? t('upper') : t('lower'));
  return t('{packRow} pack row, column {packColumn}; {cellRow} cell row, column {cellColumn}', {
    packRow: rowName(packRow),
    packColumn,
    cellRow: rowName(cellRow),
    cellColumn,
  });
}

/** Neighbours of a cell in the series string. */
export function neighbours(index: number): number[] {
  return [index - 1, index + 1].filter((i) => i >= 0 && i < 8 * CELLS_PER_PACK);
}
