// Why the accumulator is not being charged, and how long until it is full.

import type { Commands, Maybe, Snapshot } from '../link/types';
import { battery } from './battery.svelte';
import { live } from './live.svelte';
import { Resource } from './resource.svelte';
import { cellName, fixed, quantity } from '../format';
import { named, t, messageText } from '../words/words.svelte';

const LEAST_A = 0.2; // below it nothing is charged
const REST_A = 2; // beyond it no voltage is one at rest

/** Whether charge flows: a sensor's noise while the master does not charge is none. */
function flows(snapshot: Snapshot): boolean {
  const current = snapshot.accumulator.current_a;
  return snapshot.master.state === 'charge' && current !== null && current < -LEAST_A;
}

/** Reasons in the order in which they have to be dealt with; empty while charge flows. */
export function whyNot(snapshot: Maybe<Snapshot>, known: boolean): string[] {
  if (live.gone) return [t('common.service_does_not_respond')];
  if (!snapshot || !known) return [t('charging.no_data_charger_master')];
  const { charger, master, accumulator, cells } = snapshot;
  if (flows(snapshot)) return [];
  const reasons: string[] = [];
  if (master.fit === false)
    reasons.push(
      t('charging.master_keeps_shutdown_circuit_open', {
        why: messageText(master.why),
      }),
    );
  if (master.flags && !master.flags['charger']) {
    reasons.push(t('charging.no_charger_check_connector_mains'));
  }
  for (const flag of charger.flags)
    reasons.push(t('charging.charger_reports_fault', { flag: named(`flag.${flag}`, flag) }));
  const missing = cells.voltage_v.filter((v) => v === null).length;
  if (missing > 0) reasons.push(t('common.cells_without_voltage_reading', { n: missing }));
  if (charger.state === 'done') reasons.push(t('charging.charging_complete_cells_reached_charge'));
  else if (charger.state === 'off' || charger.state === null)
    reasons.push(t('charging.charging_not_started'));
  else if (charger.state === 'waiting') reasons.push(t('charging.waiting_charger_respond'));
  else if (charger.state === 'balancing') {
    reasons.push(
      t('charging.charging_paused_balancing_others_high', {
        cell: cellName(accumulator.voltage_max_cell),
        v: quantity((accumulator.voltage_delta_v ?? 0) * 1000, 'mV'),
      }),
    );
  } else if (charger.state === 'fault') reasons.push(t('charging.charging_stopped_fault'));
  if (reasons.length === 0 && charger.asked_current_a !== null) {
    reasons.push(t('charging.master_requests_but_no_current', { a: fixed(charger.asked_current_a, 1) }));
  }
  return reasons;
}

/** Seconds at the present current until the first cell is full, null where none is charged or nothing is known. */
export function secondsToFull(snapshot: Maybe<Snapshot>): Maybe<number> {
  const current = snapshot?.accumulator.current_a ?? null;
  if (!snapshot || current === null || !flows(snapshot)) return null;
  let least: Maybe<number> = null;
  snapshot.cells.soc.forEach((soc, i) => {
    const capacity = snapshot.cells.capacity_ah[i];
    if (soc === null || capacity === null || capacity === undefined) return;
    const seconds = (Math.max(0, 1 - soc) * capacity * 3600) / -current;
    if (least === null || seconds < least) least = seconds;
  });
  return least;
}

// The commands there are, and why some would be refused now.
class CommandConditions extends Resource<Commands> {
  private known = '';

  /** Ask again when the car's state is another one; call inside a component's effect. */
  follow(): void {
    const { snapshot } = live;
    const state = JSON.stringify([
      live.answers && battery.hasMaster,
      live.freshness('status') === 'blank',
      snapshot?.master.state,
      snapshot?.master.fit,
      snapshot?.master.flags?.load,
      snapshot?.charger.state,
      Math.abs(snapshot?.accumulator.current_a ?? 0) >= REST_A,
    ]);
    if (state === this.known) return;
    this.known = state;
    if (live.answers && battery.hasMaster) void this.read('commands');
  }

  /** Why a command cannot work now, in words; empty where it may. */
  blocks(name: string): string {
    return messageText(this.value?.block_reasons[name]);
  }
}
export const commands = new CommandConditions();
