// Which share of the cells a battery tells at one instant: joints, leaks and capacity are judged from 40 % on, as
// cells of other instants carried other currents.

export const AT_ONCE = 0.4; // AT_ONCE of app/estimation/health/cell_watch.py
const TOGETHER_S = 0.15;

/** The largest share of cells whose voltages are of one instant, by the ages of all; 1 where no ages are known. */
export function toldAtOnce(ages_s: readonly (number | null)[] | null | undefined): number {
  if (!ages_s?.length) return 1;
  const known = ages_s.filter((each) => each !== null).sort((a, b) => a - b);
  let most = 0;
  for (let first = 0, last = 0; last < known.length; last++) {
    while (known[last]! - known[first]! > TOGETHER_S) first++;
    most = Math.max(most, last - first + 1);
  }
  return most / ages_s.length;
}
