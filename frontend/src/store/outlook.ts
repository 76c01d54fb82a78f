// What lies ahead, in words: limits and reasons as people call them, and the first limit of a list.

import type { PowerReason, Trip, TripLimit } from '../link/types';

export const LIMITS: Record<TripLimit, string> = {
  v_min: 'lowest voltage',
  v_max: 'highest voltage',
  soc_min: 'empty',
  soc_max: 'full',
  temperature_max: 'too hot',
};

export const REASONS: Record<PowerReason, string> = {
  voltage: 'voltage',
  soc: 'charge',
  temperature: 'heat',
  current: 'current limit',
};

/** The limit that is met first; null when none is within the hour that is looked at. */
export function firstTrip(trips: readonly Trip[]): Trip | null {
  let first: Trip | null = null;
  for (const trip of trips) {
    if (trip.seconds !== null && (first?.seconds == null || trip.seconds < first.seconds)) first = trip;
  }
  return first;
}

/** A horizon's name: the shortest is what can be had at once. */
export const horizonName = (seconds: number): string => (seconds <= 1 ? 'now' : `${seconds} s`);
