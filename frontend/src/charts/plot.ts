// A time chart on uPlot: bands of minimum and maximum, gaps as gaps, labels at the line's end, a shared crosshair.

import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import { clock, fixed } from '../format';
import type { Band } from '../store/decimate';
import { places, stepOf } from '../theme/scale';
import { DrawQueue } from './draw_queue';
import { gestures, type GestureAxis } from './gestures';
import { picture } from './picture';

export interface PlotSeries {
  label: string;
  colour: string; // name of a colour token
  decimals: number;
}

/** A vertical line at an instant, named above it. */
export interface Mark {
  time: number;
  label: string;
  colour: string; // name of a colour token
}

/** A stretch of time that is not like the others: from, to. */
export type Shade = readonly [number, number];

export interface PlotSpec {
  series: PlotSeries[];
  unit: string;
  height: number;
  least: number; // narrowest range of the y axis
  sync: string;
  axis: boolean; // draw the time axis
  hands: Hands;
}

/** What a chart does about the gestures on it. */
export type Hands = Pick<GestureAxis, 'isZoomed' | 'look' | 'whole' | 'pick'>;

const LABEL_HEIGHT = 15;
const TICK_SPACE = 26;
const LABEL_EMS = 6.8; // room for "max 4.0000 V" at the right of the lines
const LATE_S = 1.5; // a line that ends earlier than this has no value now

interface Theme {
  ink: string;
  faint: string;
  line: string;
  surface: string;
  font: string;
}

const token = (style: CSSStyleDeclaration, name: string): string => style.getPropertyValue(name).trim();

function readTheme(host: Element): Theme {
  const style = getComputedStyle(host);
  return {
    ink: token(style, '--ink'),
    faint: token(style, '--faint'),
    line: token(style, '--line'),
    surface: token(style, '--surface'),
    font: `${Math.round(parseFloat(getComputedStyle(document.documentElement).fontSize) * 0.8125)}px Plex, sans-serif`,
  };
}

const turns = new DrawQueue((draw) => requestAnimationFrame(draw));

/** One chart in `host`; `set` gives it one band per series, all on the same times, and the newest values to label. */
export class Plot {
  private readonly chart: uPlot;
  private readonly theme: Theme;
  private readonly colours: string[];
  private marks: readonly Mark[] = [];
  private shades: readonly Shade[] = [];
  private latest: readonly (number | null)[] = [];
  private readonly release: () => void;

  constructor(
    host: HTMLElement,
    private readonly spec: PlotSpec,
  ) {
    this.theme = readTheme(host);
    const style = getComputedStyle(host);
    this.colours = spec.series.map((s) => token(style, `--${s.colour}`));
    this.chart = new uPlot(this.options(host.clientWidth), [[]] as unknown as uPlot.AlignedData, host);
    this.release = gestures(this.chart.over, {
      ...spec.hands,
      place: () => this.chart.over.getBoundingClientRect(),
      range: () => [this.chart.scales['x']!.min ?? 0, this.chart.scales['x']!.max ?? 1],
      box: (from, to) => {
        const { left, height } = this.chart.over.getBoundingClientRect();
        const width = from === null ? 0 : Math.abs(to - from);
        this.chart.setSelect(
          { left: from === null ? 0 : Math.min(from, to) - left, top: 0, width, height: width ? height : 0 },
          false,
        );
      },
    });
  }

  /** The chart under its title. */
  picture(title: string): Promise<Blob | null> {
    const { canvas } = this.chart.ctx;
    return picture(canvas, this.chart.width, this.chart.height, title, getComputedStyle(this.chart.root));
  }

  set(
    bands: readonly Band[],
    from: number,
    to: number,
    marks: readonly Mark[] = [],
    shades: readonly Shade[] = [],
    latest: readonly (number | null)[] = [],
  ): void {
    turns.ask(this, () => {
      this.latest = latest;
      this.marks = marks;
      this.shades = shades;
      this.chart.batch(() => {
        this.chart.setData(aligned(bands), false);
        this.chart.setScale('x', { min: from, max: to });
      });
    });
  }

  /** Draw what was set without waiting for a turn. */
  drawNow(): void {
    turns.hurry(this);
  }

  resize(width: number): void {
    if (width > 0) this.chart.setSize({ width, height: this.spec.height });
  }

  destroy(): void {
    turns.forget(this);
    this.release();
    this.chart.destroy();
  }

  private options(width: number): uPlot.Options {
    const { spec, theme } = this;
    const series: uPlot.Series[] = [{}];
    const bands: uPlot.Band[] = [];
    spec.series.forEach((_, i) => {
      const stroke = this.colours[i]!;
      series.push(
        { stroke, width: 1, points: { show: false } },
        { stroke, width: 1, points: { show: false } },
      );
      bands.push({ series: [2 * i + 2, 2 * i + 1], fill: `${stroke}59` });
    });
    const axis: uPlot.Axis = {
      stroke: theme.faint,
      font: theme.font,
      grid: { stroke: theme.line, width: 1 },
      ticks: { show: false },
    };
    return {
      width: width || 300,
      height: spec.height,
      padding: [8, Math.round(LABEL_EMS * parseFloat(theme.font)), spec.axis ? 0 : 6, 0],
      legend: { show: false },
      cursor: {
        points: { show: false },
        drag: { x: false, y: false, setScale: false },
        bind: { dblclick: () => null }, // would show what the data hold, not what is in view
        sync: { key: spec.sync },
      },
      scales: { x: { time: true }, y: { range: (_u, low, high) => this.range(low, high) } },
      axes: [
        {
          ...axis,
          show: spec.axis,
          size: 28,
          space: 72,
          values: (_u, splits) =>
            splits.map((t) =>
              splits.length > 1 && splits[1]! - splits[0]! < 60 ? clock(t) : clock(t).slice(0, 5),
            ),
        },
        {
          ...axis,
          size: 52,
          space: (_u, _i, low, high, length) =>
            Math.min(TICK_SPACE, (0.99 * length * stepOf(low, high, length, TICK_SPACE)) / (high - low)),
          incrs: (_u, _i, low, high, length) => [stepOf(low, high, length, TICK_SPACE)],
          values: (u, splits) => splits.map((v) => (isEmpty(u.data) ? '' : fixed(v, places(splits)))),
        },
      ],
      series,
      bands,
      hooks: {
        drawClear: [(u) => this.shade(u)],
        draw: [(u) => this.lines(u), (u) => this.labels(u)],
        setCursor: [(u) => u.redraw(false)],
      },
    };
  }

  private range(low: number | null, high: number | null): [number, number] {
    const { least } = this.spec;
    if (low === null || high === null || !Number.isFinite(low) || !Number.isFinite(high)) return [0, least];
    const span = Math.max(high - low, least);
    const middle = (low + high) / 2;
    return [middle - span * 0.56, middle + span * 0.56];
  }

  private shade(u: uPlot): void {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.fillStyle = this.theme.line;
    for (const [from, to] of this.shades) {
      const left = Math.max(bbox.left, u.valToPos(from, 'x', true));
      const right = Math.min(bbox.left + bbox.width, u.valToPos(to, 'x', true));
      if (right > left) ctx.fillRect(left, bbox.top, Math.max(right - left, devicePixelRatio), bbox.height);
    }
    ctx.restore();
  }

  private lines(u: uPlot): void {
    const { ctx } = u;
    const ratio = devicePixelRatio;
    if (this.marks.length === 0) return; // asking for a style makes the browser work it out at once
    const style = getComputedStyle(u.root);
    ctx.save();
    ctx.lineWidth = ratio;
    ctx.font = this.font;
    ctx.textAlign = 'left';
    for (const mark of this.marks) {
      const x = Math.round(u.valToPos(mark.time, 'x', true));
      if (x < u.bbox.left || x > u.bbox.left + u.bbox.width) continue;
      ctx.strokeStyle = ctx.fillStyle = token(style, `--${mark.colour}`);
      ctx.beginPath();
      ctx.moveTo(x, u.bbox.top);
      ctx.lineTo(x, u.bbox.top + u.bbox.height);
      ctx.stroke();
      ctx.fillText(mark.label, x + 3 * ratio, u.bbox.top + 10 * ratio);
    }
    ctx.restore();
  }

  private get font(): string {
    return this.theme.font.replace(/^\d+/, (px) => String(Number(px) * devicePixelRatio));
  }

  private labels(u: uPlot): void {
    const { ctx } = u;
    const ratio = devicePixelRatio;
    const right = u.bbox.left + u.bbox.width + 8 * ratio;
    const rows: { y: number; text: string; colour: string }[] = [];
    this.spec.series.forEach((s, i) => {
      const at = this.labelIndex(u, 2 * i + 1);
      if (at === null) return;
      const low = u.data[2 * i + 1]![at];
      const high = u.data[2 * i + 2]![at];
      if (low === null || low === undefined || high === null || high === undefined) return;
      const value = (isUnderCursor(u) ? null : this.latest[i]) ?? (low + high) / 2;
      const text = `${s.label ? `${s.label} ` : ''}${fixed(value, s.decimals)} ${this.spec.unit}`;
      rows.push({ y: u.valToPos(value, 'y', true), text, colour: this.colours[i]! });
    });
    rows.sort((a, b) => a.y - b.y);
    for (let i = 1; i < rows.length; i++) {
      rows[i]!.y = Math.max(rows[i]!.y, rows[i - 1]!.y + LABEL_HEIGHT * ratio);
    }
    ctx.save();
    ctx.font = this.font;
    ctx.textBaseline = 'middle';
    ctx.textAlign = 'left';
    for (const row of rows) {
      ctx.fillStyle = row.colour;
      ctx.fillText(row.text, right, Math.min(row.y, u.bbox.top + u.bbox.height));
    }
    ctx.restore();
  }

  private labelIndex(u: uPlot, column: number): number | null {
    if (isUnderCursor(u)) return u.cursor.idx!;
    const data = u.data[column];
    if (!data) return null;
    let last = data.length - 1;
    while (last >= 0 && (data[last] === null || data[last] === undefined)) last--;
    const { min, max } = u.scales['x']!;
    const late = Math.max(LATE_S, 0.01 * ((max ?? 0) - (min ?? 0)));
    return last >= 0 && (max ?? 0) - u.data[0][last]! <= late ? last : null;
  }
}

const isUnderCursor = (u: uPlot): boolean => u.cursor.idx != null && (u.cursor.left ?? -1) >= 0;

/** One table for the chart; bands on other times than the first are joined to it without being bridged. */
function aligned(bands: readonly Band[]): uPlot.AlignedData {
  const tables = bands.map((b) => [b.time, b.min, b.max] as unknown as uPlot.AlignedData);
  const first = bands[0];
  if (!first) return [[]];
  if (bands.every((b) => b.time === first.time || sameTimes(b.time, first.time))) {
    return [first.time, ...bands.flatMap((b) => [b.min, b.max])] as unknown as uPlot.AlignedData;
  }
  return uPlot.join(tables);
}

/** Whether there is nothing to draw: an axis without values has no numbers. */
export const isEmpty = (columns: readonly (ArrayLike<unknown> | undefined)[]): boolean =>
  columns.slice(1).every((column) => {
    for (let i = 0; i < (column?.length ?? 0); i++) if (column![i] != null) return false;
    return true;
  });

const sameTimes = (a: readonly number[], b: readonly number[]): boolean =>
  a.length === b.length && a[0] === b[0] && a.at(-1) === b.at(-1) && a[a.length >> 1] === b[a.length >> 1];
