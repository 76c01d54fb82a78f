"""LTC6804-2 packets as the chips read them: commands and register groups with their PEC15.

A packet is the command (2 bytes), its PEC15, and for reads and writes 6 data bytes with a PEC15 of their own, most
significant byte first; register values inside the data are low byte first. Source: the LTC6804 data sheet.
"""

import enum

from firmware_protocol.errors import DecodeError

GROUP_SIZE = 6
PEC_SIZE = 2
PEC15_SEED = 0x0010
PEC15_POLYNOMIAL = 0x4599
DISCHARGE_MINUTES = (0, 0.5, 1, 2, 3, 4, 5, 10, 15, 20, 30, 40, 60, 75, 90, 120)  # by DCTO code; 0 = no timer


class Command(enum.IntEnum):
    """Command codes of 11 bits; those of conversions carry mode and channel."""

    WRCFG = 0x001
    RDCFG = 0x002
    RDCVA = 0x004
    RDCVB = 0x006
    RDCVC = 0x008
    RDCVD = 0x00A
    RDAUXA = 0x00C
    RDAUXB = 0x00E
    RDSTATA = 0x010
    RDSTATB = 0x012
    CLRCELL = 0x711
    CLRAUX = 0x712
    CLRSTAT = 0x713
    PLADC = 0x714
    DIAGN = 0x715
    WRCOMM = 0x721
    RDCOMM = 0x722
    STCOMM = 0x723


READ_CELLS = (Command.RDCVA, Command.RDCVB, Command.RDCVC, Command.RDCVD)


class AdcMode(enum.IntEnum):
    """Conversion speed; in brackets with CFGR's adcopt set."""

    FAST = 1  # 27 kHz (14 kHz)
    NORMAL = 2  # 7 kHz (3 kHz)
    FILTERED = 3  # 26 Hz (2 kHz)


def _pec15_entry(byte: int) -> int:
    remainder = byte << 7
    for _ in range(8):
        remainder = remainder << 1 ^ (PEC15_POLYNOMIAL if remainder & 0x4000 else 0)
    return remainder & 0x7FFF


_PEC15_TABLE = tuple(_pec15_entry(byte) for byte in range(256))


def pec15(data: bytes) -> int:
    """Return the 16-bit word that follows `data` on the bus: the 15-bit PEC and a 0."""
    remainder = PEC15_SEED
    for byte in data:
        remainder = (remainder << 8 ^ _PEC15_TABLE[remainder >> 7 & 0xFF ^ byte]) & 0x7FFF
    return remainder << 1


def with_pec(data: bytes) -> bytes:
    """Return `data` and its PEC15."""
    return data + pec15(data).to_bytes(PEC_SIZE, "big")


def decode_command(packet: bytes) -> tuple[int, int | None]:
    """Return (command, address) of a packet's first four bytes; the address is None in a broadcast.

    Raises:
        DecodeError: fewer than four bytes, a wrong PEC, or address bits in a broadcast.
    """
    if len(packet) < 4:
        raise DecodeError("LTC6804 command", f"{len(packet)} bytes, at least 4")
    if with_pec(packet[:2]) != packet[:4]:
        raise DecodeError("LTC6804 command", "PEC", 2)
    command = (packet[0] & 0x07) << 8 | packet[1]
    if packet[0] & 0x80:
        return command, packet[0] >> 3 & 0x0F
    if packet[0] > 0x07:
        raise DecodeError("LTC6804 command", "address bits without the address mark", 0)
    return command, None


def decode_group(reply: bytes) -> bytes:
    """Return the six data bytes of a chip's answer.

    Raises:
        DecodeError: not eight bytes, or a wrong PEC.
    """
    if len(reply) != GROUP_SIZE + PEC_SIZE:
        raise DecodeError("LTC6804 register group", f"{len(reply)} bytes, not {GROUP_SIZE + PEC_SIZE}")
    if with_pec(reply[:GROUP_SIZE]) != reply:
        raise DecodeError("LTC6804 register group", "PEC", GROUP_SIZE)
    return reply[:GROUP_SIZE]


# The temperature sensor inside an Energus module: its voltage at a temperature, linear between the 33 points that
# Energus publishes, -40 to 120 degC in steps of 5 K. The curve falls: 12 mV/K at 25 degC, 1 to 2 mV/K at its ends.
SENSOR_FIRST_DEGC = -40
SENSOR_STEP_DEGC = 5
# fmt: off
SENSOR_POINTS_V = (
    2.44, 2.42, 2.40, 2.38, 2.35, 2.32, 2.27, 2.23,  # -40 to -5 degC
    2.17, 2.11, 2.05, 1.99, 1.92, 1.86, 1.80, 1.74,  # 0 to 35
    1.68, 1.63, 1.59, 1.55, 1.51, 1.48, 1.45, 1.43,  # 40 to 75
    1.40, 1.38, 1.37, 1.35, 1.34, 1.33, 1.32, 1.31, 1.30,  # 80 to 120
)
# fmt: on
SENSOR_MARGIN_V = 0.005  # half of the table's last digit
