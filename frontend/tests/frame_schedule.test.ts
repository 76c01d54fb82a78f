import { describe, expect, it } from 'vitest';
import { FrameSchedule } from '../src/store/frame_schedule';

const FRAME_MS = 1000 / 60;

const steps = (frames: number, changed: (frame: number) => boolean): (string | null)[] => {
  const pace = new FrameSchedule();
  return Array.from({ length: frames }, (_, frame) => pace.next(frame * FRAME_MS, changed(frame)));
};

describe('the pace of drawing', () => {
  it('draws all numbers of a snapshot in one frame and the charts in the next', () => {
    expect(steps(5, (frame) => frame === 0)).toEqual(['numbers', 'charts', null, null, null]);
  });

  it('finishes what it began while new snapshots come in', () => {
    const found = steps(60, () => true);
    const count = (step: string): number => found.filter((each) => each === step).length;
    expect(count('numbers')).toBeGreaterThanOrEqual(14);
    expect(count('charts')).toBe(count('numbers'));
  });

  it('goes on a few times a second while nothing arrives', () => {
    const found = steps(60, () => false);
    expect(found.filter((each) => each === 'numbers')).toHaveLength(4);
    expect(found.filter((each) => each === 'charts')).toHaveLength(4);
  });

  it('asks for no frame until the next is due, and for all of them while something has changed', () => {
    const pace = new FrameSchedule();
    const found = [0, 1, 2].map((frame) => {
      pace.next(frame * FRAME_MS, frame === 0);
      return [false, true].map((changed) => Math.round(pace.pause(frame * FRAME_MS, changed)));
    });
    expect(found).toEqual([
      [0, 0], // the charts of the first snapshot
      [233, 0],
      [217, 0],
    ]);
    expect(pace.next(2 * FRAME_MS + 217, false)).toBe('numbers');
  });

  it('draws the first snapshot after a long silence at once', () => {
    const pace = new FrameSchedule();
    expect(pace.next(10_000, true)).toBe('numbers');
  });
});
