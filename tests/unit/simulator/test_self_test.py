from firmware_protocol.ltc6804 import AdcMode, Command
from simulator.conversion import ADOW, AXST, CVST, STATST, SelfTest, decode_self_test
from tests.ltc6804_packets import adax, adcv, adstat


def test_self_test_commands_are_those_of_the_data_sheet():
    commands = [SelfTest(kind, AdcMode.NORMAL, pattern).command for kind in (CVST, AXST, STATST) for pattern in (1, 2)]
    assert commands == [0x327, 0x347, 0x527, 0x547, 0x52F, 0x54F]


def test_no_conversion_is_taken_for_a_self_test():
    modes = list(AdcMode)
    others = [
        adcv(mode, discharge_permitted=dcp, channel=n) for mode in modes for dcp in (False, True) for n in range(7)
    ]
    others += [adax(mode, n) for mode in modes for n in range(7)] + [
        adstat(mode, n) for mode in modes for n in range(5)
    ]
    others += [ADOW | mode << 7 | pull for mode in modes for pull in (0, 0x40)] + list(Command)
    assert [command for command in others if decode_self_test(command) is not None] == []
