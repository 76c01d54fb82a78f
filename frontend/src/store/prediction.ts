// What lies ahead, in words: limits and reasons as people call them, and the first limit of a list.

import type { PowerReason, Trip, TripLimit } from '../link/types';
import type { Text } from '../words/words.svelte';

export const LIMITS: Record<TripLimit, Text> = {
  v_min: 'lowest voltage',
  v_max: 'highest voltage',
  soc_min: 'empty',
  soc_max: 'full',
  temperature_max: 'too hot',
};

export const REASONS: Record<PowerReason, Text> = {
  voltage: 'voltage',
  soc: 'charge',
  temperature: 'heat',
  current: 'current limit',
  relays: 'relays open',
};

/** The limit that is met first; null when none is within the hour that is looked at. */
export function firstTrip(trips: readonly Trip[]): Trip | null {
  let first: Trip | null = null;
  for (const trip of trips) {
    if (trip.seconds !== null && (first?.seconds == null || trip.seconds < first.seconds)) first = trip;
  }
  return first;
}
