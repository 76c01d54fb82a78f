import { describe, expect, it } from 'vitest';
import { bitRateOf, deviceOf, withBitRate, withoutBitRate } from '../src/store/links';

describe('the bit rate in the address of a bus', () => {
  it.each([
    ['slcan:COM5', 'slcan:COM5?bitrate=250000'],
    ['slcan:COM5?bitrate=500000', 'slcan:COM5?bitrate=250000'],
    ['slcan:COM5?bitrate=500000&timeout=1', 'slcan:COM5?timeout=1&bitrate=250000'],
    ['slcan:COM5?timeout=1&bitrate=500000&fd=true', 'slcan:COM5?timeout=1&fd=true&bitrate=250000'],
  ])('%s takes another one', (url, expected) => {
    expect(withBitRate(url, 250_000)).toBe(expected);
    expect(bitRateOf(expected)).toBe(250_000);
    expect(withoutBitRate(expected)).toBe(withoutBitRate(url));
  });

  it('is the usual one where none is named, and unknown where the system sets it', () => {
    expect(bitRateOf('pcan:PCAN_USBBUS1')).toBe(500_000);
    expect(bitRateOf('socketcan:can0')).toBeNull();
  });
});

it('one device as a serial port and as a CAN adapter is the same', () => {
  expect(deviceOf('slcan:/dev/ttyACM0?bitrate=250000')).toBe(deviceOf('/dev/ttyACM0'));
  expect(deviceOf('pcan:PCAN_USBBUS1')).not.toBe(deviceOf('/dev/ttyACM0'));
});
