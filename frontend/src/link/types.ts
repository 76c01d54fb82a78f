// The service's answers, as `make generated` writes them down, and the names that pages use for their parts.
// null is missing, never zero.

import type {
  Age,
  Alarm,
  CanRx,
  CanTx,
  Health,
  Master,
  PowerLimit,
  StoredConfig,
  Trip,
} from '../generated/api';

export type * from '../generated/api';

export type Maybe<T> = T | null;
export type Part = keyof Age;
export type Severity = Alarm['severity'];
export type MasterState = Master['state'];
export type Source = Health['source'];
export type PowerReason = PowerLimit['reason'];
export type TripLimit = Trip['limit'];
export type RawConfig = StoredConfig['raw'];
export type RawValue = RawConfig[string];

/** An entry of either CAN table, as it is edited. */
export type CanMessage = Omit<CanTx, 'period_ms' | 'name' | 'signals' | 'latency_ms' | 'load'> &
  Partial<Pick<CanTx, 'period_ms' | 'name' | 'signals' | 'latency_ms' | 'load'>> &
  Partial<Pick<CanRx, 'timeout_ms' | 'response' | 'charges' | 'active'>>;
