import { describe, expect, it } from 'vitest';
import { lines, Shape, viewOf, type Outline } from '../src/store/shape.svelte';

const equal = (n: number, size: number): number[] => Array<number>(n).fill(size);
const TEAM: Outline = {
  segments: equal(8, 12),
  drawing: { rows: 2, order: [0, 1, 2, 3, 7, 6, 5, 4], turned: [] },
};
const SHAPES: [string, Outline][] = [
  ['one pack', { segments: [14] }],
  ['six of twelve', { segments: equal(6, 12) }],
  ['the team’s', TEAM],
  ['ten of fourteen', { segments: equal(10, 14) }],
  ['one of 140', { segments: [140] }],
  ['eight of twenty', { segments: equal(8, 20) }],
  ['twelve of eighteen', { segments: equal(12, 18) }],
  ['thirty of twenty', { segments: equal(30, 20) }],
  [
    'of different sizes',
    { segments: [10, 12, 14, 1], drawing: { rows: 2, order: [3, 1, 0, 2], turned: [1] } },
  ],
];

describe('the team’s map', () => {
  const shape = new Shape(TEAM);
  const cell = (pack: number, n: number): number => (pack - 1) * 12 + n - 1;

  it('is two rows of four packs, in each two rows of six cells, out and back', () => {
    expect(shape.rows).toEqual([
      [0, 1, 2, 3],
      [7, 6, 5, 4],
    ]);
    expect(shape.cellRows(1)).toEqual([
      [12, 13, 14, 15, 16, 17],
      [23, 22, 21, 20, 19, 18],
    ]);
  });

  it('is walked as it is built: out, over and back, to its edge', () => {
    expect(shape.besides(cell(1, 6), 1, 0)).toBe(cell(2, 1));
    expect(shape.besides(cell(1, 1), 0, 1)).toBe(cell(1, 12));
    expect(shape.besides(cell(1, 12), 0, 1)).toBe(cell(8, 1));
    expect(shape.besides(cell(1, 1), -1, 0)).toBeNull();
    expect(shape.besides(cell(1, 1), 0, -1)).toBeNull();
    expect(shape.besides(cell(4, 6), 1, 0)).toBeNull();
    expect(shape.besides(cell(8, 12), 0, 1)).toBeNull();
  });

  it('keeps the six cells beside each other on every screen', () => {
    for (const screen of ['wide', 'middle', 'phone'] as const)
      for (const big of [true, false]) {
        const drawn = new Shape(TEAM, viewOf(shape, screen, big));
        expect(drawn.columns).toBe(6);
        expect(drawn.across).toBe({ wide: 4, middle: 2, phone: big ? 1 : 2 }[screen]);
      }
  });
});

describe.each(SHAPES)('a battery: %s', (_, outline) => {
  const shape = new Shape(outline);
  const cells = Array.from({ length: shape.nCells }, (_, i) => i);

  it('draws every cell once, on every screen', () => {
    for (const screen of ['wide', 'middle', 'phone'] as const)
      for (const big of [true, false]) {
        const drawn = new Shape(outline, viewOf(shape, screen, big));
        const found = drawn.rows.flat().flatMap((pack) => drawn.cellRows(pack).flat());
        expect(found.filter((cell) => cell !== null).sort((a, b) => a - b)).toEqual(cells);
      }
  });

  it('finds back the cell of every place', () => {
    for (const cell of cells) {
      const { pack, position } = shape.place(cell)!;
      expect(shape.cells(pack)[position]).toBe(cell);
    }
    expect(shape.place(shape.nCells)).toBeNull();
    expect(shape.place(-1)).toBeNull();
  });

  it('comes back from where it went, everywhere', () => {
    for (const cell of cells)
      for (const [dx, dy] of [
        [1, 0],
        [0, 1],
      ] as const) {
        const next = shape.besides(cell, dx, dy);
        if (next !== null) expect(shape.besides(next, -dx, -dy)).toBe(cell);
      }
  });

  it('has a seat of its own for every cell', () => {
    expect(new Set(cells.map((cell) => JSON.stringify(shape.seat(cell)))).size).toBe(shape.nCells);
  });

  it('is a table of all cells in lines that are not longer than asked', () => {
    for (const most of [8, 20]) {
      const found = lines(shape, most);
      expect(found.flatMap((line) => line.cells)).toEqual(cells);
      expect(Math.max(...found.map((line) => line.cells.length))).toBeLessThanOrEqual(most);
      for (const { pack, first, cells } of found) expect(shape.cells(pack)[first]).toBe(cells[0]);
    }
  });
});

describe('where no drawing tells', () => {
  it.each([
    [equal(1, 14), 1],
    [equal(6, 12), 3],
    [equal(10, 14), 6],
    [equal(8, 20), 8],
    [equal(12, 18), 9],
    [equal(12, 20), 12],
  ])('%j fits a screen: at most %i rows of cells', (segments, rows) => {
    const shape = new Shape({ segments });
    expect(shape.cellRowsInAll).toBeLessThanOrEqual(rows);
    expect(shape.columns * shape.across * 42).toBeLessThanOrEqual(1180);
  });

  it('counts a turned pack from right to left', () => {
    const shape = new Shape({ segments: [3, 3], drawing: { rows: 1, order: [1, 0], turned: [1] } });
    expect(shape.rows).toEqual([[1, 0]]);
    expect(shape.cellRows(1)).toEqual([[5, 4, 3]]);
    expect(shape.besides(3, 1, 0)).toBe(0);
  });
});

describe('temperature sensors', () => {
  it('tell which cells they stand for, and whether each cell has one of its own', () => {
    const shape = new Shape({ segments: [4], sensors: [[0, 1], [2], [2]] });
    expect(shape.isEachMeasured).toBe(false);
    expect(shape.sharesSensor(0)).toEqual([1]);
    expect(shape.sensors(2)).toEqual([1, 2]);
    expect(shape.sharesSensor(2)).toEqual([]);
    expect(shape.sensors(3)).toEqual([]);
    expect(new Shape({ segments: [2], sensors: [[0], [1]] }).isEachMeasured).toBe(true);
  });
});
