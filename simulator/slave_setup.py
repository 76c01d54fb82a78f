"""How the slaves are set up: the BMS thesis's registers, waits, addresses and order of temperatures (B.8 to B.10).

The C master has the same in `firmware_protocol/c/master/vw_slaves.h`. Where a wait belongs is not printed beside its
four numbers; the data sheet leaves one place for two of them: twelve cells take 4.430 ms at 2 kHz and 1.288 ms at
14 kHz, the two rates that the configuration's ADCOPT gives.
"""

from firmware_protocol.ltc6804 import AdcMode

FIRST_ADDRESS = 1  # switches on the boards: 1 to 8
DEFAULT_CFGR = bytes((0x05, 0x98, 0x46, 0xA4, 0x00, 0x10))  # GPIO pull-downs, refon, adcopt, 2.7024 and 4.2048 V, 30 s
CELLS_MODE = AdcMode.FILTERED  # 2 kHz
SENSORS_MODE = AdcMode.FAST  # 14 kHz
WAKE_WAIT_S = 500e-6
CELLS_WAIT_S = 4500e-6
SENSORS_WAIT_S = 1400e-6
SWITCH_WAIT_S = 100e-6  # ten time constants of the sensors' filter of 16 kHz, after they are switched in
QUIET_S = 2e-3  # without traffic, then a wake-up pulse comes before the next packet

THESIS_SENSOR_INPUTS = (0, 2, 4, 6, 8, 10, 1, 3, 5, 7, 9, 11)  # cell inputs of sensors 1 to 12
