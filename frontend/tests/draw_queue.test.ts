import { describe, expect, it } from 'vitest';
import { DrawQueue } from '../src/charts/draw_queue';

/** DrawQueue on a clock that only drawing moves, and a way to let a frame pass. */
function made(): { turns: DrawQueue; spend: (ms: number) => void; frame: () => void } {
  let ms = 0;
  let next: (() => void) | null = null;
  const turns = new DrawQueue(
    (draw) => (next = draw),
    () => ms,
  );
  return {
    turns,
    spend: (by) => (ms += by),
    frame: () => {
      const draw = next;
      next = null;
      draw?.();
    },
  };
}

describe('turns of charts', () => {
  it('spread costly drawing over frames and lose none', () => {
    const { turns, spend, frame } = made();
    const drawn: number[] = [];
    for (let i = 0; i < 7; i++)
      turns.ask({}, () => {
        spend(4);
        drawn.push(i);
      });
    const after = Array.from({ length: 5 }, () => (frame(), drawn.length));
    expect(after).toEqual([2, 4, 6, 7, 7]);
    expect(drawn).toEqual([0, 1, 2, 3, 4, 5, 6]);
  });

  it('draw only the last that one chart asked for', () => {
    const { turns, frame } = made();
    const chart = {};
    const drawn: string[] = [];
    turns.ask(chart, () => drawn.push('old'));
    turns.ask(chart, () => drawn.push('new'));
    frame();
    frame();
    expect(drawn).toEqual(['new']);
  });

  it('draw at once for one that hurries, and not again', () => {
    const { turns, frame } = made();
    const chart = {};
    const drawn: string[] = [];
    turns.ask(chart, () => drawn.push('printed'));
    turns.hurry(chart);
    frame();
    expect(drawn).toEqual(['printed']);
  });

  it('let every chart draw while one asks again and again', () => {
    const { turns, spend, frame } = made();
    const drawn = [0, 0, 0];
    const charts = [{}, {}, {}];
    for (let n = 0; n < 30; n++) {
      charts.forEach((chart, i) =>
        turns.ask(chart, () => {
          spend(10);
          drawn[i]!++;
        }),
      );
      frame();
    }
    expect(drawn).toEqual([10, 10, 10]);
  });

  it('draw nothing for a chart that is gone', () => {
    const { turns, frame } = made();
    const chart = {};
    turns.ask(chart, () => {
      throw new Error('drawn');
    });
    turns.forget(chart);
    frame();
  });
});
