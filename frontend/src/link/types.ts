// The service's answers as the pages see them. null is missing, never zero.

export type Maybe<T> = T | null;
export type Part = 'current' | 'voltage' | 'temperature' | 'status' | 'soc' | 'charger' | 'slaves' | 'config';
export type Severity = 'watch' | 'warning' | 'trip';
export type Role = 'engineer' | 'viewer';
export type MasterState = 'unknown' | 'idle' | 'drive' | 'charge' | 'balance' | 'fault';
export type LinkState = 'off' | 'connecting' | 'silent' | 'live' | 'lost';
export type Source = 'simulator' | 'serial' | 'can' | 'replay';

export interface Me {
  role: Maybe<Role>;
  name: Maybe<string>;
  password_required: boolean;
}

export interface Cells {
  voltage_v: Maybe<number>[];
  temperature_degc: Maybe<number>[];
  soc: Maybe<number>[];
  soc_sigma: Maybe<number>[];
  ocv_v: Maybe<number>[];
  residual_v: Maybe<number>[];
  resistance_ohm: Maybe<number>[];
  capacity_ah: Maybe<number>[];
  soh_capacity: Maybe<number>[];
  joint_excess_ohm: Maybe<number>[];
  balancing: Maybe<boolean>[];
  model_valid: Maybe<boolean>[];
  joint_loose: Maybe<boolean>[];
}

export interface Pack {
  voltage_v: Maybe<number>;
  min_v: Maybe<number>;
  max_v: Maybe<number>;
  delta_v: Maybe<number>;
  temperature_max_degc: Maybe<number>;
  temperature_min_degc: Maybe<number>;
  slave_status: Maybe<number>;
}

export interface Accumulator {
  voltage_v: Maybe<number>;
  current_a: Maybe<number>;
  power_w: Maybe<number>;
  soc: Maybe<number>;
  soc_sigma: Maybe<number>;
  driver_soc_percent: Maybe<number>;
  soc_min: Maybe<number>;
  soc_min_cell: Maybe<number>;
  soc_max: Maybe<number>;
  soc_max_cell: Maybe<number>;
  soc_spread: Maybe<number>;
  voltage_min_v: Maybe<number>;
  voltage_min_cell: Maybe<number>;
  voltage_max_v: Maybe<number>;
  voltage_max_cell: Maybe<number>;
  voltage_mean_v: Maybe<number>;
  voltage_delta_v: Maybe<number>;
  temperature_min_degc: Maybe<number>;
  temperature_min_cell: Maybe<number>;
  temperature_max_degc: Maybe<number>;
  temperature_max_cell: Maybe<number>;
  temperature_mean_degc: Maybe<number>;
  loaded_cells: Maybe<number>;
  energy_out_wh: Maybe<number>;
  energy_in_wh: Maybe<number>;
  fan_duty: Maybe<number>;
}

export type PowerReason = 'voltage' | 'soc' | 'temperature' | 'current';
export type TripLimit = 'v_min' | 'v_max' | 'soc_min' | 'soc_max' | 'temperature_max';

export interface PowerLimit {
  horizon_s: number;
  power_w: number;
  current_a: number;
  cell: Maybe<number>;
  reason: PowerReason;
}

export interface Power {
  discharge: PowerLimit[];
  charge: PowerLimit[];
}

export interface Trip {
  limit: TripLimit;
  seconds: Maybe<number>;
  cell: Maybe<number>;
}

export interface Laps {
  laps: number;
  low: number;
  high: number;
  lap_energy_wh: number;
  lap_energy_sigma_wh: number;
  period_s: Maybe<number>;
}

export interface Prediction {
  power: Maybe<Power>;
  to_trip: Trip[];
  to_trip_full: Trip[];
  nearest: Maybe<Trip>;
  energy_left_wh: Maybe<number>;
  energy_left_sigma_wh: Maybe<number>;
  energy_left_cell: Maybe<number>;
  laps: Maybe<Laps>;
}

export interface Master {
  state: MasterState;
  why: string;
  fit: Maybe<boolean>;
  flags: Maybe<Record<string, boolean>>;
  soc: Maybe<number>;
  charge_drawn_ah: Maybe<number>;
  n_slaves: Maybe<number>;
  can_tx_enabled: Maybe<number>;
  can_rx_enabled: Maybe<number>;
  can_rx_active: Maybe<number>;
  firmware: Maybe<string>;
  protocol: Maybe<number>;
  map_hash: Maybe<string>;
  map_matches: Maybe<boolean>;
  boots: Maybe<number>;
}

export interface Charger {
  state: Maybe<string>;
  asked_voltage_v: Maybe<number>;
  asked_current_a: Maybe<number>;
  voltage_v: Maybe<number>;
  current_a: Maybe<number>;
  enabled: Maybe<boolean>;
  flags: string[];
}

export interface Link {
  state: LinkState;
  url: Maybe<string>;
  age_s: Maybe<number>;
  frames: number;
  lost: number;
  crc_errors: Maybe<number>;
  resyncs: Maybe<number>;
  bytes: number;
  rate_hz: number;
  bytes_per_s: number;
  line_load: Maybe<number>;
  bus_load?: Maybe<number>;
  reconnects: number;
  error: Maybe<string>;
}

export interface Alarm {
  id: number;
  code: string;
  severity: Severity;
  text: string;
  cell: Maybe<number>;
  value: Maybe<number>;
  limit: Maybe<number>;
  unit: Maybe<string>;
  since: number;
  active: boolean;
  acknowledged_by: Maybe<string>;
}

export interface Recording {
  session_id: string;
  since: number;
  frames: number;
  bytes: number;
}

export interface Replay {
  session_id: string;
  position_s: number;
  duration_s: number;
  speed: number;
  paused: boolean;
}

export interface Snapshot {
  seq: number;
  time: number;
  uptime_s: Maybe<number>;
  source: Source;
  age: Record<Part, Maybe<number>>;
  cells: Cells;
  packs: Pack[];
  accumulator: Accumulator;
  prediction: Maybe<Prediction>;
  master: Master;
  charger: Charger;
  links: { rs232: Link; can: Link };
  estimator: { filter: string; cell: string; step_us: Maybe<number>; started: boolean; skipped: number };
  recording: Maybe<Recording>;
  replay?: Maybe<Replay>;
  alarms: Alarm[];
  last_event_id: number;
  config_hash: Maybe<string>;
  config_stored_hash: Maybe<string>;
}

export interface History {
  time: number[];
  series: Record<string, Maybe<number>[]>;
}

export interface SchemaField {
  name: string;
  offset: number;
  type: string;
  count: number;
  shape: number[];
  unit: string;
  scale: number;
  minimum: Maybe<number>;
  maximum: Maybe<number>;
  default: Maybe<number | number[]>;
  group: string;
  meaning: string;
}

export interface StructField {
  name: string;
  offset: number;
  type: string;
  count: number;
  shape: number[];
  unit: string;
  scale: number;
  meaning: string;
}

export interface Schema {
  map_hash: string;
  fields: SchemaField[];
  struct: StructField[];
  groups: string[];
}

export type RawValue = number | number[] | number[][];
export type RawConfig = Record<string, RawValue>;

export interface Config {
  hash: string;
  stored_hash: Maybe<string>;
  age_s: Maybe<number>;
  values: Record<string, unknown>;
  raw: RawConfig;
}

export interface StoredConfig {
  hash: string;
  raw: RawConfig;
  counter: number;
}

export interface Difference {
  field: string;
  element: Maybe<number>;
  from: number;
  to: number;
  unit: string;
  offset: number;
}

export interface WriteResult {
  hash: string;
  written: boolean;
  dry_run: boolean;
  verified: boolean;
  difference: Difference[];
  warnings: (string | { message: string })[];
}

export interface CanMessage {
  index: number;
  enabled: boolean;
  id: number;
  extended: boolean;
  period_ms?: number;
  timeout_ms?: number;
  response?: Maybe<number>;
  active?: boolean;
  length: number;
  bytes: number[];
  signals?: { name: string; start_byte: number; length: number; byte_order: 'little' | 'big' }[];
}

export interface CanTables {
  bit_rate: number;
  tx: CanMessage[];
  rx: CanMessage[];
  bus_load: Maybe<number>;
}

export interface CanFrame {
  time: number;
  id: number;
  extended: boolean;
  direction: string;
  data: string;
  name: Maybe<string>;
  period_s: Maybe<number>;
  count: number;
}

export interface Session {
  id: string;
  name: string;
  started: number;
  ended: Maybe<number>;
  duration_s: Maybe<number>;
  frames: number;
  bytes: number;
  recording: boolean;
  closed: boolean;
  event_count: number;
}

export interface Marker {
  time: number;
  text: string;
  kind: Maybe<string>;
}

export interface SessionSeries {
  signals: Record<string, { time: number[]; min: Maybe<number>[]; max: Maybe<number>[]; unit: string }>;
  gaps: [number, number][];
}

export interface LogEvent {
  id: number;
  time: number;
  uptime_s: Maybe<number>;
  severity: 'info' | Severity;
  code: string;
  text: string;
  cell: Maybe<number>;
  value: Maybe<number>;
  limit: Maybe<number>;
  unit: Maybe<string>;
  who: Maybe<string>;
}

export interface Health {
  status: 'ok' | 'degraded';
  version: string;
  uptime_s: number;
  source: string;
  reasons: string[];
}

export interface FaultKind {
  name: string;
  meaning: string;
  target: 'none' | 'pack' | 'cell';
  unit: string;
  minimum: number;
  maximum: number;
  default: number;
  is_instant: boolean;
}

export interface FaultInForce {
  fault: string;
  value: number;
  since_s: number;
  until_s: Maybe<number>;
  pack?: number;
  cell?: number;
}

export interface SimulatorStatus {
  time_s: number;
  speed: Maybe<number>;
  scenario: string;
  phase: string;
  lap: number;
  soc: number;
  current_a: number;
  master_is_running: boolean;
  active: FaultInForce[];
}

export interface Scenario {
  name: string;
  title: string;
  description: string;
}

export interface UnreadableScenario {
  name: string;
  reason: string;
}

export interface Simulator {
  scenario: string;
  status: SimulatorStatus;
  scenarios: Scenario[];
  unreadable: UnreadableScenario[];
  faults: FaultKind[];
}
