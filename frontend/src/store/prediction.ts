// What lies ahead, in words: limits and reasons as people call them, and the first limit of a list.

import { signed } from '../format';
import type { EnergyTarget, PowerReason, Trip, TripLimit } from '../link/types';
import type { Text } from '../words/words.svelte';

export const LIMITS: Record<TripLimit, Text> = {
  v_min: 'overview.undervoltage',
  v_max: 'overview.overvoltage',
  soc_min: 'overview.empty',
  soc_max: 'overview.full',
  temperature_max: 'overview.overtemperature',
};

export const REASONS: Record<PowerReason, Text> = {
  voltage: 'overview.voltage',
  soc: 'common.soc',
  temperature: 'overview.temperature',
  current: 'overview.current_limit',
  relays: 'common.contactors_open',
};

/** The limit that is met first; null when none is within the hour that is looked at. */
export function firstTrip(trips: readonly Trip[]): Trip | null {
  let first: Trip | null = null;
  for (const trip of trips) {
    if (trip.seconds !== null && (first?.seconds == null || trip.seconds < first.seconds)) first = trip;
  }
  return first;
}

// How the lap that is driven compares with what it may take.
export interface Compared {
  text: string; // "+3 %"
  isThis: boolean; // else the lap before: nothing is usual of this one yet
  state: 'over' | 'within';
}

const LEAST_WH = 20; // so early in a lap a share of it says nothing
const OVER = 0.02; // less is the driver's lap-to-lap scatter

/** Compare this lap up to now, else the one before, with the target; null where there is nothing to compare. */
export function compared(target: EnergyTarget): Compared | null {
  const { lap_energy_wh: aim, used_wh: used, expected_wh: usual, last_lap_wh: last } = target;
  if (aim === null || aim <= 0) return null;
  const isThis = usual !== null && usual >= LEAST_WH;
  if (!isThis && last === null) return null;
  const excess = isThis ? used / usual - 1 : last! / aim - 1;
  return { text: `${signed(100 * excess, 0)} %`, isThis, state: excess > OVER ? 'over' : 'within' };
}

/** What a person types as reserve or laps, as a number within its limits; null where it is none. */
export function within(text: string, least: number, most: number): number | null {
  const value = Number(text.trim().replace(',', '.'));
  return text.trim() !== '' && value >= least && value <= most ? value : null;
}
