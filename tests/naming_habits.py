"""Naming habits of Formula Student teams: how they call cells, current, states, and what looks like them.

Written after public DBCs and manuals, none of them copied. `truth` says which signal tells what; `{signal}=1,2` the
values that mean yes.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from tests.peer_messages import Bits, Peer, Sent, fixed


@dataclass
class Named(Peer):
    """A battery of which is known what its signals mean."""

    texts: str = ""  # VAL_ lines
    truth: dict[str, str] = field(default_factory=dict)

    def dbc(self) -> str:
        return super().dbc() + self.texts


def plain(head: tuple[int, str, int, float], *signals: Bits) -> Sent:
    """Return a message without a multiplexer: its id, name, size and period [s], and its signals."""
    return Sent(*head, [list(signals)])


def volts(peer: Peer, i: int, factor: float = 1.0) -> Callable[[float], float]:
    return lambda t: factor * peer.voltage(i, t)


def heat(peer: Peer, i: int) -> Callable[[float], float]:
    return lambda t: peer.temperature(i, t)


def amps(peer: Peer, factor: float = 1.0) -> Callable[[float], float]:
    return lambda t: factor * peer.current(t)


def closed(t: float) -> float:
    return float(t > 1.2)


def precharge(t: float) -> float:
    return float(0.6 < t <= 1.2)


def state(t: float) -> float:
    """0 off, 1 pre-charge, 2 on."""
    return 0.0 if t < 0.6 else (1.0 if t <= 1.2 else 2.0)


def told(text: str) -> dict[str, str]:
    """Return `state:signal=1,2` `...` by state."""
    return dict(each.split(":", 1) for each in text.split())


def parts(n: int, k: int) -> Iterable[range]:
    return (range(i, min(i + k, n)) for i in range(0, n, k))


def adjusted_decoy() -> Named:
    """140 cells under a multiplexer, and as many adjusted ones that are not the cells."""
    peer = Named("VoltageCellNN muxed by 3, adjusted decoy", 140, 140, resolution_v=0.0001)

    def turns(n, nm, mx, f, unit, kind):
        out = []
        for m, r in enumerate(parts(n, 3)):
            out.append(
                [Bits(mx, 0, 8, fixed(m), is_mux=True)]
                + [
                    Bits(f"{nm}{i + 1:02d}", 8 + 16 * j, 16, kind(peer, i), f, unit=unit, mux=m)
                    for j, i in enumerate(r)
                ]
            )
        return out

    peer.sent = [
        Sent(
            0x98089401,
            "BMU_CellVoltage",
            8,
            0.02,
            turns(140, "VoltageCell", "VoltageCellMuxSelect", 0.0001, "V", volts),
        ),
        Sent(
            0x98849401,
            "BMU_CellVoltage_Adjusted",
            8,
            0.02,
            turns(
                140,
                "AdjustedVoltageCell",
                "AdjustedVoltageCellMuxSelect",
                0.0001,
                "V",
                lambda peer, i: lambda t: peer.voltage(i, t) + 0.002 * peer.current(t),
            ),
        ),
        Sent(
            0x980A9401,
            "BMU_ChannelTemp",
            8,
            0.05,
            turns(140, "TempChannel", "TempChannelMuxSelect", 0.01, "degC", heat),
        ),
        plain((0x88029401, "BMU_AmsVBatt", 8, 0.1), Bits("AMS_PackVoltage", 0, 16, peer.pack_voltage, 0.01)),
        plain(
            (0x8A029401, "BMU_stateBusHV", 8, 0.05),
            Bits("CurrentBusHV", 32, 32, amps(peer), 0.001, unit="A", signed=True),
            Bits("VoltageBusHV", 0, 32, lambda t: peer.pack_voltage(t) * closed(t), 0.001, unit="V"),
        ),
        plain(
            (0x8A039401, "BMU_batteryStatusHV", 8, 0.1),
            Bits("StateBatteryChargeHV", 0, 16, fixed(66), 0.01, unit="%"),
            Bits("TempCellMax", 16, 16, fixed(40), 0.01),
            Bits("VoltageCellMin", 32, 16, fixed(3.4), 0.0001),
            Bits("VoltageCellMax", 48, 16, fixed(3.9), 0.0001),
        ),
        plain((0x8B039401, "PrechargeState", 8, 0.1), Bits("PrechargeState", 0, 8, state)),
        plain(
            (0x8B049401, "BMU_contactorState", 2, 0.1),
            Bits("StateContactorNegative", 0, 3, lambda t: 1 + closed(t)),
            Bits("StateContactorPositive", 3, 3, lambda t: 1 + closed(t)),
        ),
        plain((0x800C9401, "ChargeEN_State", 8, 0.1), Bits("ChargeEN_State", 0, 1, fixed(0))),
    ]
    peer.texts = (
        'VAL_ 2332267521 PrechargeState 0 "idle" 1 "precharge" 2 "done" ;\n'
        'VAL_ 2332333057 StateContactorPositive 4 "CONTACTOR_FAULT_CLOSED" 3 "CONTACTOR_FAULT_OPEN" '
        '2 "CONTACTOR_CLOSED" 1 "CONTACTOR_OPEN" 0 "INVALID" ;\n'
    )
    peer.truth = told(
        "current:CurrentBusHV pack_voltage:AMS_PackVoltage soc:StateBatteryChargeHV "
        "closed:StateContactorPositive precharge:PrechargeState charging:ChargeEN_State"
    )
    return peer


def pairs_in_fd_frames() -> Named:
    """160 cells in 64-byte frames, voltage and temperature by turns; relays as bits."""
    peer = Named("160 cells, FD 64 bytes, u8 pairs alternating", 160, 160, resolution_v=0.01)
    for k, r in enumerate(parts(160, 32)):
        b = []
        for j, i in enumerate(r):
            b += [
                Bits(f"V{i}", 16 * j, 8, volts(peer, i), 0.01, 2, "V"),
                Bits(f"T{i}", 16 * j + 8, 8, heat(peer, i), 0.25, -10, "C"),
            ]
        peer.sent.append(plain((0x400 + k, f"AMS_Stack{k}_Data", 64, 0.1), *b))
    peer.sent += [
        plain(
            (0x300, "AMS_Pack", 16, 0.02),
            Bits("PackVoltage", 0, 16, peer.pack_voltage, 0.1, unit="V"),
            Bits("PackCurrent", 16, 16, amps(peer), 0.1, unit="A", signed=True),
            Bits("SoC", 32, 8, fixed(66), 0.5, unit="%"),
            Bits("AIR_P", 40, 1, closed),
            Bits("AIR_N", 41, 1, closed),
            Bits("PC_Relay", 42, 1, precharge),
            Bits("AMS_Error", 43, 1, fixed(0)),
            Bits("IMD_Error", 44, 1, fixed(0)),
            Bits("Charging", 45, 1, fixed(0)),
            Bits("BalancingActive", 46, 1, fixed(0)),
        )
    ]
    peer.truth = told(
        "current:PackCurrent pack_voltage:PackVoltage soc:SoC closed:AIR_P "
        "precharge:PC_Relay fault:AMS_Error charging:Charging balancing:BalancingActive"
    )
    return peer


def german_names() -> Named:
    """German words in one, module and cell in the signal."""
    peer = Named("Zellspannung_Modul_Zelle in German", 144, 72, resolution_v=0.001, segments=(12,) * 12)
    for m in range(12):
        for k in range(3):
            peer.sent.append(
                plain(
                    (0x200 + 4 * m + k, f"Modul{m + 1}_Zellspannungen_{k + 1}", 8, 0.1),
                    *[
                        Bits(
                            f"Modul{m + 1}_Zellspannung_{4 * k + j + 1}",
                            16 * j,
                            16,
                            volts(peer, 12 * m + 4 * k + j),
                            0.001,
                            unit="V",
                        )
                        for j in range(4)
                    ],
                )
            )
        peer.sent.append(
            plain(
                (0x200 + 4 * m + 3, f"Modul{m + 1}_Temperaturen", 8, 0.5),
                *[
                    Bits(f"Modul{m + 1}_Zelltemperatur_{j + 1}", 8 * j, 8, heat(peer, 6 * m + j), 1, -40, unit="Cel")
                    for j in range(6)
                ],
            )
        )
    peer.sent += [
        plain(
            (0x100, "AMS_Gesamt", 8, 0.02),
            Bits("Gesamtspannung", 0, 16, peer.pack_voltage, 0.1, unit="V"),
            Bits("Strom", 16, 16, amps(peer), 0.1, unit="A", signed=True),
            Bits("Ladezustand", 32, 8, fixed(66), 1, unit="%"),
            Bits("Schuetz_Plus", 40, 1, closed),
            Bits("Schuetz_Minus", 41, 1, closed),
            Bits("Vorladerelais", 42, 1, precharge),
            Bits("Fehler_AMS", 43, 1, fixed(0)),
            Bits("Laden_aktiv", 44, 1, fixed(0)),
        )
    ]
    peer.truth = told(
        "current:Strom pack_voltage:Gesamtspannung soc:Ladezustand "
        "closed:Schuetz_Plus precharge:Vorladerelais fault:Fehler_AMS charging:Laden_aktiv"
    )
    return peer


def letters_in_numbered_messages() -> Named:
    """Cells a to d of numbered messages; the state as a number with texts."""
    peer = Named("adbms6830_cell_voltage of numbered messages, no cell number in names", 160, 80, resolution_v=0.00015)
    for k, r in enumerate(parts(160, 4)):
        peer.sent.append(
            plain(
                (0x600 + k, f"cell_voltages_{k:02d}", 8, 0.1),
                *[
                    Bits(f"cell_voltage_{'abcd'[j]}", 16 * j, 16, volts(peer, i), 0.00015, 1.5, "V")
                    for j, i in enumerate(r)
                ],
            )
        )
    for k, r in enumerate(parts(80, 8)):
        peer.sent.append(
            plain(
                (0x640 + k, f"cell_temperatures_{k:02d}", 8, 0.5),
                *[
                    Bits(f"cell_temperature_{'abcdefgh'[j]}", 8 * j, 8, heat(peer, i), 0.5, -20, "degC")
                    for j, i in enumerate(r)
                ],
            )
        )
    peer.sent += [
        plain(
            (0x650, "accumulator_status", 8, 0.02),
            Bits("ts_voltage", 0, 16, peer.pack_voltage, 0.02, unit="V"),
            Bits("ts_current", 16, 16, amps(peer), 0.02, unit="A", signed=True),
            Bits("soc", 32, 8, fixed(0.66), 0.005),
            Bits("ts_state", 40, 3, state),
            Bits("sdc_closed", 43, 1, closed),
            Bits("ams_ok", 44, 1, fixed(1)),
            Bits("imd_ok", 45, 1, fixed(1)),
        )
    ]
    peer.texts = 'VAL_ 1616 ts_state 0 "TS_OFF" 1 "TS_PRECHARGING" 2 "TS_ACTIVE" 3 "TS_CHARGING" 4 "TS_ERROR" ;\n'
    peer.truth = told(
        "current:ts_current pack_voltage:ts_voltage soc:soc "
        "closed:ts_state=2,3 precharge:ts_state=1 fault:ts_state=4 charging:ts_state=3"
    )
    return peer


def pages_of_slaves() -> Named:
    """Pages of cells and temperatures under one multiplexer a slave."""
    peer = Named("v_cell[] one message a slave, mux page", 112, 112, resolution_v=0.002, segments=(14,) * 8)
    for s in range(8):
        turns = []
        for k, r in enumerate(parts(14, 3)):
            turns.append(
                [Bits("page", 0, 4, fixed(k), is_mux=True)]
                + [
                    Bits(f"slave{s}_vcell{i}", 16 + 16 * j, 12, volts(peer, 14 * s + i), 0.0015, unit="V", mux=k)
                    for j, i in enumerate(r)
                ]
            )
        for k, r in enumerate(parts(14, 6)):
            turns.append(
                [Bits("page", 0, 4, fixed(8 + k), is_mux=True)]
                + [
                    Bits(f"slave{s}_tcell{i}", 16 + 8 * j, 8, heat(peer, 14 * s + i), 1, -40, unit="degC", mux=8 + k)
                    for j, i in enumerate(r)
                ]
            )
        peer.sent.append(Sent(0x180 + s, f"SLAVE{s}_DATA", 8, 0.02, turns))
    peer.sent += [
        plain(
            (0x190, "MASTER_HV", 8, 0.02),
            Bits("hv_voltage", 0, 16, peer.pack_voltage, 0.1, unit="V"),
            Bits("hv_current", 16, 16, amps(peer), 0.1, unit="A", signed=True),
            Bits("hv_soc", 32, 8, fixed(66), 1, unit="%"),
        ),
        plain(
            (0x191, "MASTER_STATE", 2, 0.1),
            Bits("hv_state", 0, 4, state),
            Bits("ams_error_flag", 8, 1, fixed(0)),
            Bits("imd_error_flag", 9, 1, fixed(0)),
        ),
    ]
    peer.texts = (
        'VAL_ 401 hv_state 0 "HV_OFF" 1 "HV_PRECHARGE" 2 "HV_ON" 3 "HV_CHARGE" 4 "HV_BALANCING" 15 "HV_ERROR" ;\n'
    )
    peer.truth = told(
        "current:hv_current pack_voltage:hv_voltage soc:hv_soc closed:hv_state=2,3 "
        "precharge:hv_state=1 fault:hv_state=15 charging:hv_state=3 balancing:hv_state=4"
    )
    return peer


HABITS = (adjusted_decoy, pairs_in_fd_frames, german_names, letters_in_numbered_messages, pages_of_slaves)
