"""Batteries as other teams speak: a DBC, its frames and what is true of them, one for each way to address cells.

Written from public descriptions; names vary as they do in the field.
"""

import re
from collections.abc import Callable

from tests.peer_messages import Bits, Peer, Sent, Value, fixed, others


def one_signal_a_cell(
    n_cells: int, n_sensors: int, name: str, sensor: str, factor: float, unit: str, base: int = 1, order: int = 1
) -> Peer:
    """Way 1: four 16-bit voltages a frame, eight temperatures of 8 bits."""
    scale = {"mV": 1000.0, "V": 1.0}[unit]
    peer = Peer(f"1: {name}", n_cells, n_sensors, resolution_v=factor / scale)

    def volt(cell: int) -> Value:
        return lambda t: peer.voltage(cell, t) * scale

    def heat(k: int) -> Value:
        return lambda t: peer.temperature(k, t)

    for f in range(0, n_cells, 4):
        bits = [
            Bits(name.format(c + base), 16 * k if order else 16 * k + 7, 16, volt(c), factor, unit=unit, order=order)
            for k, c in enumerate(range(f, min(f + 4, n_cells)))
        ]
        peer.sent.append(Sent(0x200 + f // 4, f"BMS_CellFrame_{f // 4 + 1}", 8, 0.2, [bits]))
    for f in range(0, n_sensors, 8):
        bits = [
            Bits(sensor.format(s + base), 8 * k, 8, heat(s), 0.5, -40, "degC")
            for k, s in enumerate(range(f, min(f + 8, n_sensors)))
        ]
        peer.sent.append(Sent(0x280 + f // 8, f"BMS_TempFrame_{f // 8 + 1}", 8, 0.5, [bits]))
    patterns = {kind: re.sub(r"{.*?}", "{cell}", each) for kind, each in (("voltage", name), ("temperature", sensor))}
    peer.profile = "".join(
        f'[[source.{kind}]]\nsignal = "{pattern}"\nbase = {base}\n' for kind, pattern in patterns.items()
    )
    peer.sent += others(peer)
    return peer


def segments_in_fd_frames() -> Peer:
    """Way 1 in CAN FD: `SegS_CellC`, 28 voltages of 16 bits in a frame of 64 bytes, temperatures likewise."""
    peer = Peer("1: FD SegA_Cell", 140, 140, segments=(28,) * 5, positive="charge")
    for s in range(5):
        letter = "ABCDE"[s]
        volts = [
            Bits(f"Seg{letter}_Cell{c + 1}", 16 * c, 16, lambda t, i=28 * s + c: peer.voltage(i, t), 0.0001, unit="V")
            for c in range(28)
        ]
        heats = [
            Bits(
                f"Seg{letter}_Temp{c + 1}",
                16 * c,
                16,
                lambda t, i=28 * s + c: peer.temperature(i, t),
                0.1,
                unit="C",
                signed=True,
            )
            for c in range(28)
        ]
        peer.sent.append(Sent(0x400 + s, f"AMS_Seg{letter}_Voltages", 64, 0.1, [volts]))
        peer.sent.append(Sent(0x410 + s, f"AMS_Seg{letter}_Temps", 64, 0.5, [heats]))
    peer.profile = (
        '[[source.voltage]]\nsignal = "Seg{segment:a}_Cell{cell}"\nbase = {segment = 0, cell = 1}\n'
        '[[source.temperature]]\nsignal = "Seg{segment:a}_Temp{cell}"\nbase = {segment = 0, cell = 1}\n'
    )
    peer.sent += others(peer, {"pack": "AMS_Status", "u": "TS_Voltage", "i": "TS_Current", "soc": "SOC"})
    return peer


def multiplexed() -> Peer:
    """Way 2: extended ids, a multiplexer, three values a frame, more sensors than cells."""
    peer = Peer("2: mux, 140 V 189 T", 140, 189)

    def turns(n: int, name: str, value: Callable[[int, float], float], factor: float, unit: str) -> list[list[Bits]]:
        found = []
        for m in range((n + 2) // 3):
            bits = [Bits("Mux", 0, 8, fixed(m), is_mux=True)]
            for k in range(3):
                if 3 * m + k < n:
                    bits.append(
                        Bits(
                            name.format(3 * m + k),
                            8 + 16 * k,
                            16,
                            lambda t, i=3 * m + k: value(i, t),
                            factor,
                            unit=unit,
                            mux=m,
                        )
                    )
            found.append(bits)
        return found

    peer.sent = [
        Sent(
            0x80000000 | 0x1806F001,
            "Accu_Voltages",
            8,
            0.5,
            turns(140, "VCell_{}", lambda i, t: peer.voltage(i, t) * 1000, 1, "mV"),
        ),
        Sent(
            0x80000000 | 0x1806F002, "Accu_Temperatures", 8, 1.0, turns(189, "TCell_{}", peer.temperature, 0.01, "degC")
        ),
        *others(peer),
    ]
    peer.resolution_v = 0.001
    peer.profile = '[[source.voltage]]\nsignal = "VCell_{cell}"\n[[source.temperature]]\nsignal = "TCell_{cell}"\n'
    return peer


def _orion_sum(can_id: int, data: bytes) -> bytes:
    return data[:7] + bytes([(can_id + len(data) + sum(data[:7])) & 0xFF])


def cell_number() -> Peer:
    """Way 3: a cell number in the frame, 72 cells, one every 100 ms, big endian, with a checksum."""
    peer = Peer("3: cell number", 72, 12)
    volts = [
        [
            Bits("Cell_ID", 7, 8, fixed(c), order=0),
            Bits("Cell_Voltage", 15, 16, lambda t, i=c: peer.voltage(i, t), 0.0001, unit="V", order=0),
            Bits("Cell_Shunting", 31, 1, fixed(c % 2), order=0),
            Bits("Cell_Resistance", 30, 15, fixed(2.1), 0.01, unit="mOhm", order=0),
            Bits("Cell_OpenVoltage", 47, 16, lambda t, i=c: peer.voltage(i, t) + 0.01, 0.0001, unit="V", order=0),
            Bits("Checksum", 63, 8, fixed(0), order=0),
        ]
        for c in range(72)
    ]
    heats = [
        [
            Bits("Thermistor_ID", 7, 8, fixed(c), order=0),
            Bits(
                "Thermistor_Value", 15, 8, lambda t, i=c: peer.temperature(i, t), 1, unit="degC", order=0, signed=True
            ),
        ]
        for c in range(12)
    ]
    peer.sent = [
        Sent(0x036, "CellBroadcast", 8, 7.2, volts, _orion_sum),
        Sent(0x076, "ThermistorBroadcast", 8, 2.4, heats),
        *others(peer, {"u": "Pack_Inst_Voltage"}),
    ]
    peer.profile = (
        '[[source.voltage]]\nsignal = "Cell_Voltage"\nnumbers = {cell = "Cell_ID"}\nchecksum = "orion"\n'
        '[[source.temperature]]\nsignal = "Thermistor_Value"\nnumbers = {cell = "Thermistor_ID"}\n'
    )
    return peer


def module_and_cell() -> Peer:
    """Way 4: one cell a frame with module and cell number, both from 1; voltage of 0.01 V, temperature with it."""
    peer = Peer("4: module and cell", 96, 96, segments=(12,) * 8, resolution_v=0.01, positive="charge")
    turns = [
        [
            Bits("voltage", 0, 16, lambda t, i=12 * m + c: peer.voltage(i, t), 0.01, unit="V"),
            Bits("module_num", 16, 8, fixed(m + 1)),
            Bits("cell_num", 24, 8, fixed(c + 1)),
            Bits("temperature", 32, 8, lambda t, i=12 * m + c: peer.temperature(i, t), 1, unit="C"),
            Bits("balance", 40, 1, fixed(0)),
        ]
        for m in range(8)
        for c in range(12)
    ]
    peer.sent = [Sent(0x310, "BMS_Cell_Data", 6, 0.96, turns), *others(peer)]
    numbers = 'numbers = {segment = "module_num", cell = "cell_num"}\nbase = 1\n'
    peer.profile = (
        f'[[source.voltage]]\nsignal = "voltage"\n{numbers}[[source.temperature]]\nsignal = "temperature"\n{numbers}'
    )
    return peer


def base_and_values() -> Peer:
    """Way 5: ic and group in the frame, three voltages of 0.1 mV without a unit."""
    peer = Peer("5: ic, group and three", 90, 0, segments=(18,) * 5)
    turns = [
        [
            Bits("ic_id", 0, 8, fixed(ic)),
            Bits("group_id", 8, 8, fixed(g)),
            *(
                Bits(f"cell_voltage_{k}", 16 + 16 * k, 16, lambda t, i=18 * ic + 3 * g + k: peer.voltage(i, t) * 1e4)
                for k in range(3)
            ),
        ]
        for ic in range(5)
        for g in range(6)
    ]
    peer.sent = [Sent(0x320, "CellVoltages", 8, 0.6, turns), *others(peer)]
    peer.profile = (
        '[[source.voltage]]\nsignal = "cell_voltage_{cell}"\nnumbers = {segment = "ic_id", group = "group_id"}\n'
        'group_cells = 3\nunit = "0.1mV"\n'
    )
    return peer


def first_cell_and_values() -> Peer:
    """Way 5 with the number of the first cell: 1, 4, 7, ..."""
    peer = Peer("5: first cell and three", 84, 0, resolution_v=0.001)
    turns = [
        [
            Bits("StartCell", 0, 8, fixed(3 * g + 1)),
            *(
                Bits(f"U_{'ABC'[k]}", 16 + 16 * k, 16, lambda t, i=3 * g + k: peer.voltage(i, t) * 1000, unit="mV")
                for k in range(3)
            ),
        ]
        for g in range(28)
    ]
    peer.sent = [Sent(0x321, "Zellspannungen", 8, 0.56, turns), *others(peer)]
    peer.profile = '[[source.voltage]]\nsignal = "U_{cell:a}"\nnumbers = {group = "StartCell"}\nbase = {group = 1}\n'
    return peer


def own_numbers() -> Peer:
    """Way 6: one chip number, two cells each with its number, voltages of 13 bits, a temperature of 10."""
    peer = Peer("6: two cells with own numbers", 108, 9, segments=(12,) * 9, resolution_v=0.001)
    turns = [
        [
            Bits("chip_id", 0, 4, fixed(chip)),
            Bits("cell_a_num", 4, 4, fixed(c)),
            Bits("cell_b_num", 8, 4, fixed(c + 1)),
            Bits("cell_a_volt", 12, 13, lambda t, i=12 * chip + c: peer.voltage(i, t), 0.001, unit="V"),
            Bits("cell_b_volt", 25, 13, lambda t, i=12 * chip + c + 1: peer.voltage(i, t), 0.001, unit="V"),
            Bits("chip_temp", 38, 10, lambda t, i=chip: peer.temperature(i, t), 0.1, unit="C"),
        ]
        for chip in range(9)
        for c in range(0, 12, 2)
    ]
    peer.sent = [Sent(0x330, "ChipFrame", 6, 0.54, turns), *others(peer)]
    peer.profile = (
        "".join(
            f'[[source.voltage]]\nsignal = "cell_{x}_volt"\nnumbers = {{segment = "chip_id", cell = "cell_{x}_num"}}\n'
            for x in "ab"
        )
        + '[[source.temperature]]\nsignal = "chip_temp"\nnumbers = {cell = "chip_id"}\n'
    )
    return peer


def alternating_fd() -> Peer:
    """Way 7: CAN FD, 64 bytes, voltage u8 (0.01, +2 V) and temperature u8 (0.25) alternate, 32 cells a frame."""
    peer = Peer("7: FD, V and T alternate", 160, 160, resolution_v=0.01)
    for m in range(5):
        bits = []
        for c in range(32):
            i = 32 * m + c
            bits.append(Bits(f"CELL_V_{i}", 16 * c, 8, lambda t, i=i: peer.voltage(i, t), 0.01, 2, "V"))
            bits.append(Bits(f"CELL_T_{i}", 16 * c + 8, 8, lambda t, i=i: peer.temperature(i, t), 0.25, 0, "degC"))
        peer.sent.append(Sent(0x340 + m, f"ACC_BLOCK_{m}", 64, 0.1, [bits]))
    peer.profile = '[[source.voltage]]\nsignal = "CELL_V_{cell}"\n[[source.temperature]]\nsignal = "CELL_T_{cell}"\n'
    peer.sent += others(peer)
    return peer


def same_names_in_each_message() -> Peer:
    """Way 1 as it is found: eighteen messages with the same four names; only their ids tell them apart."""
    peer = Peer("1: same names in each message", 72, 0)
    for f in range(18):
        bits = [
            Bits(f"CellVoltage_{k + 1}", 16 * k, 16, lambda t, i=4 * f + k: peer.voltage(i, t), 0.0001, unit="V")
            for k in range(4)
        ]
        can_id = (0x3B0 if f < 2 else 0x3D0) + f
        peer.sent.append(Sent(can_id, f"UNK_{can_id:X}", 8, 0.2, [bits]))
        peer.profile += (
            f'[[source.voltage]]\nmessage = "UNK_{can_id:X}"\nsignal = "CellVoltage_{{cell}}"\n'
            f"base = 1\nfirst = {4 * f + 1}\n"
        )
    peer.sent += others(peer)
    return peer


def module_and_group_in_the_message() -> Peer:
    """Way 1 with numbers in the message's name: `BMS_Module_02_Cells_05_08` and `Voltage1` to `Voltage4`."""
    peer = Peer("1: module and cells in the message", 96, 48, segments=(12,) * 8)
    for m in range(8):
        for g in range(3):
            bits = [
                Bits(
                    f"Voltage{k + 1}", 16 * k, 16, lambda t, i=12 * m + 4 * g + k: peer.voltage(i, t), 0.0001, unit="V"
                )
                for k in range(4)
            ]
            name = f"BMS_Module_{m + 1:02d}_Cells_{4 * g + 1:02d}_{4 * g + 4:02d}"
            peer.sent.append(Sent(0x300 + 3 * m + g, name, 8, 0.1, [bits]))
        heats = [
            Bits(f"Temp{k + 1}", 8 * k, 8, lambda t, i=6 * m + k: peer.temperature(i, t), 1, -40, "C") for k in range(6)
        ]
        peer.sent.append(Sent(0x380 + m, f"BMS_Module_{m + 1:02d}_Temps", 8, 0.5, [heats]))
    peer.profile = (
        '[[source.voltage]]\nmessage = "BMS_Module_{segment}_Cells_{group}_*"\nsignal = "Voltage{cell}"\nbase = 1\n'
        '[[source.temperature]]\nmessage = "BMS_Module_{segment}_Temps"\nsignal = "Temp{cell}"\nbase = 1\n'
    )
    peer.sent += others(peer)
    return peer


def half_a_round() -> Peer:
    """Way 3 so slow that the log ends before every cell was told, and the numbers begin anew within it."""
    peer = cell_number()
    slow = peer.sent[0]
    peer.name = "3: slow, begun in the middle"
    peer.sent[0] = Sent(slow.can_id, slow.name, 8, 18.0, slow.turns[30:] + slow.turns[:30], slow.fix)
    return peer


PEERS: list[Callable[[], Peer]] = [
    lambda: one_signal_a_cell(90, 45, "Voltage_Cell_{:02d}", "Temp_Sensor_{:02d}", 0.0001, "V"),
    lambda: one_signal_a_cell(72, 24, "cv{}", "ct{}", 1, "mV", base=0, order=0),
    lambda: one_signal_a_cell(84, 30, "CELL_V_{}", "CELL_NTC_{}", 0.01, "V", base=0),
    lambda: one_signal_a_cell(60, 20, "Zelle_{:03d}_Spannung", "Zelle_{:03d}_Temp", 0.1, "mV"),
    segments_in_fd_frames,
    multiplexed,
    cell_number,
    module_and_cell,
    base_and_values,
    first_cell_and_values,
    own_numbers,
    alternating_fd,
    same_names_in_each_message,
    module_and_group_in_the_message,
]
