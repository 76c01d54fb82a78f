import { afterEach, beforeEach, expect, it, vi } from 'vitest';
import { undo } from '../src/store/undo.svelte';

beforeEach(() => void vi.useFakeTimers());
afterEach(() => void vi.useRealTimers());

it('what was thrown away is taken back once', () => {
  const back = vi.fn();
  undo.let('Changes discarded', back);
  expect(undo.offer?.what).toBe('Changes discarded');
  undo.take();
  undo.take();
  expect(back).toHaveBeenCalledOnce();
  expect(undo.offer).toBeNull();
});

it('an offer ends with its time, and a later one has a time of its own', () => {
  undo.let('first', vi.fn());
  vi.advanceTimersByTime(15_000);
  undo.let('second', vi.fn());
  vi.advanceTimersByTime(15_000);
  expect(undo.offer?.what).toBe('second');
  vi.advanceTimersByTime(5_000);
  expect(undo.offer).toBeNull();
});
