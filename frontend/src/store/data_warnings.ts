// What the service and this page are unsure of, in plain words.

import type { Maybe, Snapshot, System } from '../link/types';
import { cellName, fixed, quantity } from '../format';
import { shapes } from './shape.svelte';
import { t } from '../words/words.svelte';

const CLOCK_OFF_S = 2;
const DISK_HOURS = 4;
const DISK_FREE_BYTES = 2e9;
const OFFSET_A = 1; // of the current sensor: 4 points of charge in an hour
const LOST_SHARE = 0.01;

/** Sentences on checks that contradict each other; empty while all that can be judged agrees. */
export function contradictions(snapshot: Maybe<Snapshot>): string[] {
  const p = snapshot?.plausibility;
  if (!p) return [];
  const found: string[] = [];
  if (p.sum.verdict === false) {
    found.push(t('system.sum_cell_voltages_accumulator_voltage', { v: quantity(p.sum.value, 'V') }));
  }
  if (p.current.verdict === false) {
    found.push(
      p.current.value === null
        ? t('system.voltages_change_while_current_constant')
        : t('system.current_voltage_inconsistent_they', {
            r: fixed(p.current.value * 1000, 2),
          }),
    );
  }
  if (p.chips.verdict === false) {
    found.push(
      t('system.slave_master_differ_mv', {
        cell: cellName(p.chips.cell),
        v: fixed((p.chips.value ?? 0) * 1000, 0),
      }),
    );
  }
  return found;
}

/** What arrives on RS232 where it is no frame of the master; empty where frames arrive, or nothing at all. */
export const unframed = (snapshot: Maybe<Snapshot>): string => {
  const link = snapshot?.links.rs232;
  return link?.unframed
    ? t('system.rs232_receives_bytes_per_second', {
        n: fixed(link.bytes_per_s, 0),
      })
    : '';
};

/** Bytes in hex with what they are as text, 16 in a line. */
export function hexLines(hex: string): string[] {
  const bytes = hex.split(' ');
  const lines: string[] = [];
  for (let i = 0; i < bytes.length; i += 16) {
    const part = bytes.slice(i, i + 16);
    const text = part.map((byte) => {
      const code = parseInt(byte, 16);
      return code >= 32 && code < 127 ? String.fromCharCode(code) : '·';
    });
    lines.push(`${part.join(' ').padEnd(48)}${text.join('')}`);
  }
  return lines;
}

/** All warnings about the data now, besides those of the service itself. */
export function dataWarnings(
  snapshot: Maybe<Snapshot>,
  system: Maybe<System>,
  clockOffS: Maybe<number>,
): string[] {
  const found = contradictions(snapshot);
  if (snapshot) {
    const { links, estimator, cells, accumulator } = snapshot;
    const missing = shapes.live.nCells - (accumulator.loaded_cells ?? 0);
    if (missing === 1) found.push(t('system.1_cell_without_voltage_reading'));
    else if (missing > 1) found.push(t('common.cells_without_voltage_reading', { n: missing }));
    if (!estimator.started) found.push(t('system.no_soc_estimate_yet'));
    const untrusted = cells.model_valid.filter((v) => v === false).length;
    if (untrusted === 1) found.push(t('system.model_does_not_fit_1'));
    else if (untrusted > 1) found.push(t('system.model_does_not_fit_cells', { n: untrusted }));
    if (accumulator.soc_source === 'master') found.push(t('system.soc_shown_master_not_estimate'));
    const { current_offset_a: offset, current_offset_sigma_a: sigma } = estimator;
    if (offset !== null && Math.abs(offset) > Math.max(OFFSET_A, 3 * (sigma ?? 0))) {
      const values = { a: fixed(Math.abs(offset), 2), sigma: fixed(sigma, 2) };
      found.push(
        offset > 0
          ? t('system.current_sensor_reads_too_high', values)
          : t('system.current_sensor_reads_too_low', values),
      );
    }
    const noFrame = unframed(snapshot);
    if (noFrame) found.push(noFrame);
    const { lost, frames } = links.rs232;
    if (lost > LOST_SHARE * frames) {
      found.push(t('system.rs232_frames_lost', { n: fixed((100 * lost) / (lost + frames), 1) }));
    }
  }
  if (clockOffS !== null && Math.abs(clockOffS) > CLOCK_OFF_S) {
    found.push(t('system.service_clock_device_differ', { n: fixed(clockOffS, 0) }));
  }
  if (system?.clock.was_set) {
    found.push(t('system.service_clock_adjusted_since_started', { n: fixed(system.clock.moved_s, 0) }));
  }
  if (system?.disk) {
    const hours = system.disk.recording_hours_left;
    if (hours !== null && hours < DISK_HOURS) found.push(t('system.disk_full_h', { n: fixed(hours, 1) }));
    else if (system.disk.free_bytes < DISK_FREE_BYTES) found.push(t('system.disk_nearly_full'));
  }
  return found;
}
