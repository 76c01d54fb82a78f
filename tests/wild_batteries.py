"""More batteries as teams' own DBCs describe them: what made `battery learn` stumble, or could have."""

from collections.abc import Callable

from tests.peer_messages import Bits, Peer, Sent, fixed, others


def slaves_with_messages_each() -> Peer:
    """The same four names in three messages of each slave, ids out of order, what each module sums up beside them."""
    peer = Peer("slaves with messages each", 96, 48, segments=(12,) * 8, resolution_v=0.001)
    for s in range(8):
        first = 0x100 + 9 * s
        ids = [first + 6, *range(first, first + 6)] if s == 2 else list(range(first, first + 7))
        for k in range(3):
            bits = [
                Bits(f"cell_voltage_{4 * k + j + 1}", 16 * j, 16, cell(peer, 12 * s + 4 * k + j), 0.001, unit="V")
                for j in range(4)
            ]
            peer.sent.append(Sent(ids[k], f"Slave_{s + 1:02d}_Voltage_ID_{k + 1}", 8, 0.2, [bits]))
        heats = [
            Bits(f"temperature_value_{j + 1}", 16 * (j % 4), 16, sensor(peer, 6 * s + j), 0.01, unit="ºC")
            for j in range(6)
        ]
        rest = [Bits("temperature_maximum", 32, 16, fixed(30), 0.01), Bits("temperature_delta", 48, 16, fixed(5), 0.01)]
        peer.sent.append(Sent(ids[3], f"Slave_{s + 1:02d}_Temperature_ID_1", 8, 0.5, [heats[:4]]))
        peer.sent.append(Sent(ids[4], f"Slave_{s + 1:02d}_Temperature_ID_2", 8, 0.5, [heats[4:] + rest]))
        sums = [Bits(f"module_voltage_{n}", 16 * j, 16, fixed(3650 + j)) for j, n in enumerate(("avg", "min", "max"))]
        peer.sent.append(Sent(ids[5], f"Slave_{s + 1:02d}_MSC_ID_1", 8, 0.5, [sums]))
        heat = [Bits("module_ic_voltage", 16, 16, fixed(5000)), Bits("module_ic_temperature", 40, 16, fixed(41))]
        peer.sent.append(Sent(ids[6], f"Slave_{s + 1:02d}_MSC_ID_2", 8, 0.5, [heat]))
    peer.sent += others(peer, {"pack": "Accumulator", "u": "total_voltage", "i": "current_value", "soc": "soc"})
    return peer


def multiplexer_of_16_bits() -> Peer:
    """12 bits with an offset of 500 mV under a multiplexer called cell_id; extremes with ids of the same offset."""
    peer = Peer("mux of 16 bits, offset 500 mV", 96, 32, resolution_v=0.001)

    def turns(
        n: int, a_turn: int, names: tuple[str, str], bits: int, value: Callable, offset: float, unit: str
    ) -> list:
        return [
            [
                Bits(names[0], 0, 16, fixed(m), is_mux=True),
                *(
                    Bits(f"{names[1]}_{i + 1}", 16 + bits * j, bits, value(peer, i), 1, offset, unit, mux=m)
                    for j, i in enumerate(range(a_turn * m, min(a_turn * m + a_turn, n)))
                ),
            ]
            for m in range(-(-n // a_turn))
        ]

    def cell_mv(peer: Peer, i: int) -> Callable[[float], float]:
        return lambda t: 1000 * peer.voltage(i, t)

    extremes = [
        Bits("cell_max_volt", 0, 12, cell_mv(peer, 1), 1, 500, "mV"),
        Bits("cell_min_volt", 24, 12, cell_mv(peer, 3), 1, 500, "mV"),
        Bits("cell_max_volt_id", 36, 8, fixed(501), 1, 500),
        Bits("cell_delta_volt", 52, 12, fixed(520), 1, 500, "mV"),
    ]
    peer.sent = [
        Sent(0x80000500, "Cell_Voltages", 8, 0.5, turns(96, 4, ("cell_id", "cell_voltage"), 12, cell_mv, 500, "mV")),
        Sent(0x80000501, "Cell_Temperatures", 8, 1.0, turns(32, 6, ("temp_id", "temp"), 8, sensor, 0, "C")),
        Sent(0x80000502, "Cell_voltage_status", 8, 0.2, [extremes]),
        *others(peer),
    ]
    return peer


def volts_that_are_millivolts() -> Peer:
    """The DBC says volts, the numbers are millivolts; messages are called like their first cell; the sum of cells."""
    peer = Peer("volts that are millivolts", 144, 9, resolution_v=0.001)
    for first in range(0, 144, 3):
        bits = [
            Bits(f"cell_{i + 1}", 16 * j, 16, lambda t, i=i: 1000 * peer.voltage(i, t), 1, unit="volts")
            for j, i in enumerate(range(first, first + 3))
        ]
        peer.sent.append(Sent(0x700 + first // 3, f"cell_{first + 1}", 8, 0.2, [bits]))
    for k in range(3):
        bits = [Bits(f"temp_{3 * k + j + 1}", 16 * j, 16, sensor(peer, 3 * k + j), 1, unit="C") for j in range(3)]
        peer.sent.append(Sent(0x780 + k, f"temp_{k + 1}", 8, 0.5, [bits]))
    total = [Bits("ID", 0, 8, fixed(1)), Bits("sum_of_cells", 16, 16, peer.pack_voltage, 0.1, unit="V")]
    peer.sent.append(Sent(0x96, "limping_mode", 8, 0.1, [total]))
    peer.sent += [each for each in others(peer, {"u": "Inverter_Voltage"}) if not each.name.startswith("MC_")]
    return peer


def ranges_in_the_message() -> Peer:
    """`CMU0CellVoltage3to5`, with a counter and a CRC in each frame that could be taken for temperatures."""
    peer = Peer("ranges in the message's name", 54, 0, segments=(18,) * 3, resolution_v=0.001)
    for cmu in range(3):
        for first in range(0, 18, 3):
            bits = [
                Bits(f"CellVoltage{first + j}", 16 * j, 16, cell(peer, 18 * cmu + first + j), 0.001, unit="V")
                for j in range(3)
            ]
            bits += [Bits("Counter", 52, 4, lambda t: int(t / 0.1) % 16), Bits("CRC", 56, 8, fixed(77))]
            name = f"CMU{cmu}CellVoltage{first}to{first + 2}"
            peer.sent.append(Sent(0x120 + 0x40 * cmu + first // 3, name, 8, 0.1, [bits]))
        state = [Bits("Error", 0, 32, fixed(0)), Bits("BalanceStatus", 32, 16, fixed(0))]
        peer.sent.append(Sent(0x100 + 0x40 * cmu, f"CMU{cmu}ErrorBalanceStatus", 8, 0.5, [state]))
    peer.sent += others(peer)
    return peer


def more_thermistors_than_cells() -> Peer:
    """Six modules with 18 cells and 56 thermistors each, module and number in the signal's name."""
    peer = Peer("modules with 56 thermistors", 108, 336, segments=(18,) * 6)
    for m in range(6):
        for k in range(6):
            bits = [
                Bits(f"Cell_{m}_{3 * k + j}_Voltage", 16 * j, 16, cell(peer, 18 * m + 3 * k + j), 0.0001, unit="V")
                for j in range(3)
            ]
            peer.sent.append(Sent(0x88F00000 + 0x1000 * m + k, f"Module_{m}_Voltage_{k}", 8, 0.2, [bits]))
        for k in range(14):
            bits = [
                Bits(f"Temp_{m}_{i:02d}", 16 * j, 16, sensor(peer, 56 * m + i), 0.1, unit="degC", signed=True)
                for j, i in enumerate(range(4 * k, 4 * k + 4))
            ]
            peer.sent.append(Sent(0x88F80000 + 0x1000 * m + k, f"Module_{m}_Temp_{k}", 8, 0.5, [bits]))
    peer.sent += others(peer)
    return peer


def cell(peer: Peer, i: int) -> Callable[[float], float]:
    return lambda t: peer.voltage(i, t)


def sensor(peer: Peer, i: int) -> Callable[[float], float]:
    return lambda t: peer.temperature(i, t)


WILD = (
    slaves_with_messages_each,
    multiplexer_of_16_bits,
    volts_that_are_millivolts,
    ranges_in_the_message,
    more_thermistors_than_cells,
)
