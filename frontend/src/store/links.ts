// Addresses of buses as the service takes them, INTERFACE:CHANNEL?bitrate=…, and what belongs to the same device.

export const BIT_RATES = [500_000, 250_000, 1_000_000, 125_000] as const;
const RATE_BY_SYSTEM = ['socketcan', 'socketcand', 'virtual', 'udp_multicast']; // python-can sets none there

/** A bus without the bit rate that it names: the same adapter. */
export function withoutBitRate(url: string): string {
  const bare = url.replace(/[?&]bitrate=[^&]*/, '');
  return bare.includes('?') ? bare : bare.replace('&', '?');
}

export function withBitRate(url: string, rate: number): string {
  const bare = withoutBitRate(url);
  return `${bare}${bare.includes('?') ? '&' : '?'}bitrate=${rate}`;
}

/** The bit rate that a bus names, python-can's usual one without; null where the system sets it. */
export function bitRateOf(url: string): number | null {
  if (RATE_BY_SYSTEM.includes(url.split(':')[0]!)) return null;
  return Number(/[?&]bitrate=(\d+)/.exec(url)?.[1] ?? BIT_RATES[0]);
}

/** The serial device of a port or of a serial adapter: the same one cannot be both. */
export const deviceOf = (url: string): string =>
  withoutBitRate(url)
    .replace(/^slcan:/, '')
    .split('?')[0]!;
