// The shape of a battery, and where its cells sit on the map: packs by the profile's drawing, in each of them the
// cells in rows, out and back. What is drawn does not depend on the window: the map is the battery.

/* eslint-disable svelte/prefer-svelte-reactivity -- a shape does not change */
import type { Battery } from '../link/types';

export type Outline = Pick<Battery, 'segments'> & Partial<Pick<Battery, 'drawing' | 'sensors'>>;

/** What a map is made for. */
export interface View {
  width: number; // px of the whole map, and
  cell: number; // of the narrowest cell that is worth drawing
  across: number; // packs side by side at most, so that each has room for its name
}

const ACROSS = 6;
export const WIDE: View = { width: 1180, cell: 42, across: ACROSS }; // on a screen of 1440
const MIDDLE: View = { width: 760, cell: 42, across: ACROSS / 2 };
const PHONE: View = { width: 358, cell: 42, across: 1 };
const PHONE_SMALL: View = { width: 358, cell: 24, across: 2 };
const PHONE_MANY: View = { width: 358, cell: 12, across: 3 };
/** Cells up to which a map fits a screen with all its numbers. */
export const MANY = 240;

/** The view for a screen; on a small one packs that stand side by side wrap. */
export function viewOf(shape: Shape, screen: 'wide' | 'middle' | 'phone', big: boolean): View {
  if (screen === 'wide') return WIDE;
  if (screen === 'middle') return { ...MIDDLE, across: Math.max(1, Math.ceil(shape.across / 2)) };
  if (shape.nCells > MANY) return PHONE_MANY;
  return big ? PHONE : PHONE_SMALL;
}

const GAP = 16; // px between packs
const ROW = 28; // px of a row of cells, and
const HEAD = 32; // of the line above a pack: what is weighed where no drawing is given

export class Shape {
  readonly starts: readonly number[];
  readonly nCells: number;
  /** Packs from 0, row by row as they are drawn. */
  readonly rows: readonly (readonly number[])[];
  /** Cells side by side in a pack. */
  readonly columns: number;
  private readonly places = new Map<number, [x: number, y: number]>();
  private readonly at = new Map<string, number>();
  private readonly sensorsOf: readonly (readonly number[])[];

  constructor(
    readonly outline: Outline,
    readonly view: View = WIDE,
  ) {
    const { segments, drawing, sensors } = outline;
    const starts: number[] = [];
    let cells = 0;
    for (const size of segments) {
      starts.push(cells);
      cells += size;
    }
    this.starts = starts;
    this.nCells = cells;
    const order = drawing?.order.length ? drawing.order : segments.map((_, i) => i);
    const isDrawn = drawing !== undefined && (drawing.rows > 1 || drawing.order.length > 0);
    const across = isDrawn ? Math.ceil(segments.length / drawing.rows) : bestAcross(segments, view);
    this.rows = chunks(order, across).flatMap((row) => chunks(row, view === WIDE ? across : view.across));
    this.columns = columnsOf(segments, this.across, view);
    let top = 0;
    for (const row of this.rows) {
      row.forEach((pack, column) =>
        this.cellRows(pack).forEach((line, y) =>
          line.forEach((cell, x) => this.put(cell, column * this.columns + x, top + y)),
        ),
      );
      top += Math.max(...row.map((pack) => this.cellRows(pack).length));
    }
    const own: number[][] = Array.from({ length: cells }, () => []);
    sensors?.forEach((stands, sensor) => stands.forEach((cell) => own[cell]?.push(sensor)));
    this.sensorsOf = own;
  }

  private put(cell: number | null, x: number, y: number): void {
    if (cell === null) return;
    this.places.set(cell, [x, y]);
    this.at.set(`${x} ${y}`, cell);
  }

  get nPacks(): number {
    return this.outline.segments.length;
  }

  /** Packs across the widest row of the map. */
  get across(): number {
    return Math.max(1, ...this.rows.map((row) => row.length));
  }

  /** Rows of cells from the top of the map to its end. */
  get cellRowsInAll(): number {
    return this.rows.reduce((n, row) => n + Math.max(...row.map((pack) => this.cellRows(pack).length)), 0);
  }

  size(pack: number): number {
    return this.outline.segments[pack] ?? 0;
  }

  /** Pack of a cell and its place in it, both from 0; null where there is no such cell. */
  place(cell: number): { pack: number; position: number } | null {
    if (!Number.isInteger(cell) || cell < 0 || cell >= this.nCells) return null;
    const pack = this.starts.findLastIndex((start) => start <= cell);
    return { pack, position: cell - this.starts[pack]! };
  }

  cells(pack: number): number[] {
    return Array.from({ length: this.size(pack) }, (_, k) => this.starts[pack]! + k);
  }

  /** Cells of a pack as they are drawn, row by row; null is an empty place. */
  cellRows(pack: number): (number | null)[][] {
    const isTurned = this.outline.drawing?.turned.includes(pack) ?? false;
    return chunks(this.cells(pack), this.columns).map((row, r) => {
      const filled = [...row, ...Array<null>(this.columns - row.length).fill(null)];
      return (r % 2 === 1) === isTurned ? filled : filled.reverse();
    });
  }

  /** The cell that lies `dx` columns and `dy` rows away on the map, null beyond its edge. */
  besides(cell: number, dx: number, dy: number): number | null {
    const place = this.places.get(cell);
    return place ? (this.at.get(`${place[0] + dx} ${place[1] + dy}`) ?? null) : null;
  }

  /** Row and column of a cell's pack on the map, and of the cell in its pack, all from 1. */
  seat(cell: number): { packRow: number; packColumn: number; cellRow: number; cellColumn: number } {
    const pack = this.place(cell)?.pack ?? 0;
    const row = this.rows.findIndex((each) => each.includes(pack));
    const cellRow = this.cellRows(pack).findIndex((each) => each.includes(cell));
    return {
      packRow: row + 1,
      packColumn: this.rows[row]!.indexOf(pack) + 1,
      cellRow: cellRow + 1,
      cellColumn: this.cellRows(pack)[cellRow]!.indexOf(cell) + 1,
    };
  }

  /** Neighbours of a cell in the series string. */
  neighbours(cell: number): number[] {
    return [cell - 1, cell + 1].filter((i) => i >= 0 && i < this.nCells);
  }

  /** The temperature sensors that stand for a cell, from 0. */
  sensors(cell: number): readonly number[] {
    return this.sensorsOf[cell] ?? [];
  }

  /** The other cells that the sensors of a cell stand for. */
  sharesSensor(cell: number): number[] {
    const all = this.sensors(cell).flatMap((sensor) => this.outline.sensors?.[sensor] ?? []);
    return [...new Set(all)].filter((other) => other !== cell).sort((a, b) => a - b);
  }

  /** Whether every cell has a sensor of its own. */
  get isEachMeasured(): boolean {
    return this.sensorsOf.every(
      (_, cell) => this.sensors(cell).length > 0 && !this.sharesSensor(cell).length,
    );
  }
}

/** A line of a table of cells: `part` names its cells where a pack takes more than one line. */
export interface Line {
  pack: number;
  first: number;
  cells: number[];
  part: string;
}

/** A table of all cells with at most `most` columns: what stands before each line, and its cells. */
export function lines(shape: Shape, most: number): Line[] {
  return shape.outline.segments.flatMap((size, pack) => {
    const wide = Math.ceil(size / Math.ceil(size / most));
    return chunks(shape.cells(pack), wide).map((cells, i) => ({
      pack,
      first: i * wide,
      cells,
      part: size > wide ? `${i * wide + 1}–${i * wide + cells.length}` : '',
    }));
  });
}

function columnsOf(segments: readonly number[], across: number, { width, cell }: View): number {
  const largest = Math.max(1, ...segments);
  const most = Math.max(1, Math.floor((width / across - GAP) / cell));
  return Math.ceil(largest / Math.ceil(largest / most));
}

/** Packs side by side where no drawing is given: the lowest map with the fewest empty places. */
function bestAcross(segments: readonly number[], view: View): number {
  const cells = segments.reduce((a, b) => a + b, 0);
  const cost = (across: number): number => {
    const columns = columnsOf(segments, across, view);
    const rows = chunks(segments, across).map((row) => Math.ceil(Math.max(...row) / columns));
    const high = rows.reduce((sum, n) => sum + n * ROW + HEAD, 0);
    const places = rows.reduce((sum, n) => sum + n * columns * across, 0);
    return high * (places / cells);
  };
  const choices = Array.from({ length: Math.min(view.across, segments.length) }, (_, i) => i + 1);
  return choices.reduce((best, each) => (cost(each) < cost(best) ? each : best), 1);
}

function chunks<T>(list: readonly T[], length: number): T[][] {
  return Array.from({ length: Math.ceil(list.length / length) }, (_, i) =>
    list.slice(i * length, (i + 1) * length),
  );
}

// Which shape the cells of a page are counted in: the battery that is measured now, or that of a recorded session.
const UNKNOWN = new Shape({ segments: [] });

class Shapes {
  /** Of what is measured or replayed now, for what is shown next to every page too. */
  live = $state.raw(UNKNOWN);
  private session = $state.raw<Shape | null>(null);

  /** Of what the page shows. */
  get here(): Shape {
    return this.session ?? this.live;
  }

  /** Show a recorded battery until the returned closure is called. */
  show(outline: Outline): () => void {
    const shape = (this.session = new Shape(outline));
    return () => {
      if (this.session === shape) this.session = null;
    };
  }
}

export const shapes = new Shapes();
