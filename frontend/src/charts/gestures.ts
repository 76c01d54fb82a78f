// What a hand does on a chart, the same on every one: wheel and two fingers zoom, a drag chooses a part, a drag with
// Shift and one finger move, a click sets a cursor, a double click shows all again.

import type { Range } from '../store/session_readings';

/** The horizontal axis of a chart, and what it does about a gesture. */
export interface GestureAxis {
  place(): { left: number; width: number }; // of the plotted area, in client pixels
  range(): Range;
  isZoomed(): boolean;
  look(range: Range, isStep: boolean): void; // a step can be taken back; the turns of a wheel are none
  whole(): void;
  pick(value: number): void;
  box(from: number | null, to: number): void; // what a drag chooses so far, in client pixels; null ends it
}

/** A range around `at` that stays in its place, wider by a factor. */
export const zoomedAt = ([from, to]: Range, at: number, factor: number): Range => [
  at - (at - from) * factor,
  at + (to - at) * factor,
];

const FEWEST_PX = 5; // less is a click
const A_NOTCH = 0.0025; // of a wheel's pixels: a notch of 100 zooms by a quarter
const A_LINE_PX = 33;
const STILL_MS = 300; // without a turn: the page no longer scrolls
const TWICE_MS = 400;

let scrollsUntil = 0; // a wheel that scrolls the page does not begin to zoom the chart that comes under it
if (typeof window !== 'undefined') {
  const scrolled = (event: WheelEvent): void => {
    if (!event.defaultPrevented) scrollsUntil = performance.now() + STILL_MS;
  };
  addEventListener('wheel', scrolled, { passive: true });
}

/** Listen to hands on the plotted area of a chart; returns what ends it. */
export function gestures(node: HTMLElement, axis: GestureAxis): () => void {
  const fingers = new Map<number, number>(); // pointer to its client x
  let start: { x: number; range: Range; pans: boolean } | null = null;
  let pinch: { range: Range; at: number; apart: number } | null = null;
  let isMoved = false;
  let clickedAt = -Infinity;

  const valueAt = (x: number, [from, to] = axis.range()): number => {
    const { left, width } = axis.place();
    return from + ((x - left) / (width || 1)) * (to - from);
  };
  const panned = (range: Range, px: number): Range => {
    const by = (px / (axis.place().width || 1)) * (range[1] - range[0]);
    return [range[0] - by, range[1] - by];
  };

  function wheel(event: WheelEvent): void {
    const [dx, dy] = event.shiftKey ? [event.deltaY, 0] : [event.deltaX, event.deltaY];
    const px = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? A_LINE_PX : 1;
    const pans = Math.abs(dx) > Math.abs(dy);
    if (performance.now() < scrollsUntil && !event.ctrlKey) return;
    if (!axis.isZoomed() && (pans || dy > 0)) return; // there is nothing more: the page scrolls
    event.preventDefault();
    const factor = Math.min(2, Math.max(0.5, Math.exp(dy * px * A_NOTCH * (event.ctrlKey ? 4 : 1))));
    const range = axis.range();
    axis.look(pans ? panned(range, -dx * px) : zoomedAt(range, valueAt(event.clientX), factor), false);
  }

  function down(event: PointerEvent): void {
    if (event.button !== 0) return;
    fingers.set(event.pointerId, event.clientX);
    if (event.isTrusted) node.setPointerCapture(event.pointerId);
    isMoved = fingers.size > 1;
    if (fingers.size === 2) {
      const [a = 0, b = 0] = [...fingers.values()];
      pinch = { range: axis.range(), at: valueAt((a + b) / 2), apart: Math.max(20, Math.abs(a - b)) };
      start = null;
      axis.box(null, 0);
    } else
      start = {
        x: event.clientX,
        range: axis.range(),
        pans: event.shiftKey || event.pointerType === 'touch',
      };
  }

  function move(event: PointerEvent): void {
    if (!fingers.has(event.pointerId)) return;
    fingers.set(event.pointerId, event.clientX);
    if (pinch && fingers.size === 2) {
      const [a = 0, b = 0] = [...fingers.values()];
      axis.look(zoomedAt(pinch.range, pinch.at, pinch.apart / Math.max(20, Math.abs(a - b))), false);
    } else if (start) {
      isMoved ||= Math.abs(event.clientX - start.x) >= FEWEST_PX;
      if (!isMoved) return;
      if (!start.pans) axis.box(start.x, event.clientX);
      else if (axis.isZoomed()) axis.look(panned(start.range, event.clientX - start.x), false);
    }
  }

  function up(event: PointerEvent): void {
    if (!fingers.delete(event.pointerId)) return;
    const from = start;
    start = null;
    if (fingers.size) return;
    pinch = null;
    axis.box(null, 0);
    if (event.type === 'pointercancel') return;
    if (!isMoved) click(event.clientX);
    else if (from && !from.pans) {
      const [a, b] = [valueAt(from.x), valueAt(event.clientX)];
      axis.look([Math.min(a, b), Math.max(a, b)], true);
    }
  }

  function click(x: number): void {
    const now = performance.now();
    if (now - clickedAt < TWICE_MS) axis.whole();
    else axis.pick(valueAt(x));
    clickedAt = now;
  }

  node.style.touchAction = 'pan-y';
  node.addEventListener('wheel', wheel, { passive: false });
  node.addEventListener('pointerdown', down);
  node.addEventListener('pointermove', move);
  node.addEventListener('pointerup', up);
  node.addEventListener('pointercancel', up);
  return () => {
    node.removeEventListener('wheel', wheel);
    node.removeEventListener('pointerdown', down);
    node.removeEventListener('pointermove', move);
    node.removeEventListener('pointerup', up);
    node.removeEventListener('pointercancel', up);
  };
}
