"""Current, pack voltage, SOC, charger and limits among all that is on a bus: signal, sign and unit, or unknown."""

from dataclasses import replace
from math import sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.infer.bus_survey import survey_bus
from app.sources.dbc.infer.readings import (
    charger_proposals,
    current_proposals,
    limit_proposals,
    pack_voltage_proposals,
    soc_proposals,
)
from tests.campaign import examples
from tests.peer_batteries import one_signal_a_cell
from tests.peer_messages import HEAD, Bits, Peer, Sent, fixed, others
from tests.unit.app.sources.dbc.infer.test_inference import codes, learned_of

CURRENTS = ("Pack_Current", "BatteryCurrent", "HV_Current", "Accu_Current", "TS_Current", "Strom_Batterie", "Pack_I")
VOLTAGES = ("Pack_Voltage", "TS_Voltage", "HV_Voltage", "Batt_U", "Total_Voltage", "PackVolt")


def line(name, unit="", bits=16, factor=1.0, sign="+", start=0, low=0, high=0):
    return f' SG_ {name} : {start}|{bits}@1{sign} ({factor},0) [{low}|{high}] "{unit}" X\n'


def surveyed(*messages, frames=()):
    text = HEAD + "".join(f"BO_ {k} {name}: 8 BMS\n{lines}" for k, (name, *lines_) in enumerate(messages, 1)
                          for lines in ["".join(lines_)])  # fmt: skip
    return survey_bus(parse_definitions(text.encode(), "x.dbc"), frames_of(list(frames)))


def names(found):
    return [str(each.reading.signal) for each in found]


@st.composite
def driven(draw):
    """A battery with a current of any name, sign and unit among the others of a car."""
    peer = one_signal_a_cell(12, 0, "Cell_{}_V", "T{}", 0.0001, "V")
    peer.positive = draw(st.sampled_from(["discharge", "charge"]))
    unit, per_a, factor = draw(st.sampled_from([("A", 1.0, 0.1), ("mA", 1000.0, 100.0), ("0.1A", 10.0, 1.0)]))
    sign = 1 if peer.positive == "discharge" else -1
    current, voltage = draw(st.sampled_from(CURRENTS)), draw(st.sampled_from(VOLTAGES))
    status = [
        Bits(voltage, 0, 16, peer.pack_voltage, 0.1, unit="V"),
        Bits(current, 16, 16, lambda t: sign * per_a * peer.current(t), factor, unit=unit, signed=True),
        Bits("SOC", 32, 8, fixed(64), 0.5, unit="%"),
    ]
    rest = [each for each in others(peer) if each.name != "BMS_PackStatus"]
    peer.sent = [each for each in peer.sent if each.name.startswith("BMS_CellFrame")]
    peer.sent += [Sent(0x5A0, "BMS_PackStatus", 8, 0.1, [status]), *rest]
    return peer, current, voltage


@settings(max_examples=examples(25))
@given(driven())
def test_current_and_pack_voltage_of_any_name_are_found_with_their_sign(case):
    peer, current, voltage = case
    _, _, inferred = learned_of(peer, 15)
    assert inferred.source.current.signal.signal == current
    assert inferred.source.current.positive == peer.positive
    assert inferred.source.pack_voltage.signal.signal == voltage
    assert inferred.source.soc.signal.signal == "SOC"
    assert "infer-sign-is" in [reason.code for reason in inferred.readings["current"].reasons]
    assert "infer-current-unit-guessed" not in codes(inferred)


@pytest.mark.parametrize("positive", ["discharge", "charge"])
def test_a_current_that_swings_slowly_between_many_frames_has_its_sign(positive):
    peer = one_signal_a_cell(12, 0, "Cell_{}_V", "T{}", 0.0001, "V")
    peer.current = lambda t: 60 + 50 * sin(0.7 * t)
    sign = 1 if positive == "discharge" else -1
    status = [
        Bits("Pack_Voltage", 0, 16, peer.pack_voltage, 0.1, unit="V"),
        Bits("Pack_Current", 16, 16, lambda t: sign * peer.current(t), 0.1, unit="A", signed=True),
    ]
    peer.sent = [replace(each, period_s=0.02) for each in peer.sent if each.name != "BMS_PackStatus"]
    peer.sent.append(Sent(0x5A0, "BMS_PackStatus", 8, 0.02, [status]))
    _, _, inferred = learned_of(peer, 15)
    assert inferred.source.current.positive == positive
    assert "infer-sign-unknown" not in codes(inferred)


def test_a_current_that_does_not_move_has_a_sign_that_is_said_to_be_unknown():
    peer = one_signal_a_cell(12, 0, "Cell_{}_V", "T{}", 0.0001, "V")
    peer.current = fixed(20.0)
    _, _, inferred = learned_of(peer, 6)
    assert "infer-sign-unknown" in [reason.code for reason in inferred.readings["current"].reasons]
    assert "infer-sign-unknown" in codes(inferred)


def test_a_current_that_has_nothing_to_do_with_the_cells_has_no_sign():
    peer, other = one_signal_a_cell(12, 0, "Cell_{}_V", "T{}", 0.0001, "V"), Peer("other", 12, 0)
    other.current = lambda t: float((7, -60, 3, 40, 40, -8, 110)[int(t / 0.31) % 7])
    frames = [frame for frame in peer.frames(12) if frame[1] != 0x5A0]
    other.sent = [each for each in others(other) if each.can_id == 0x5A0]
    frames += other.frames(12)
    definitions = parse_definitions(peer.dbc().encode(), "x.dbc")
    found = current_proposals(survey_bus(definitions, frames_of(sorted(frames))), None, set())
    best = next(each for each in found if each.reading.signal.signal == "Pack_Current")
    assert "infer-sign-unknown" in [reason.code for reason in best.reasons]


def test_a_current_without_any_unit_is_said_to_be_a_guess():
    peer = one_signal_a_cell(12, 0, "Cell_{}_V", "T{}", 0.0001, "V")
    text = peer.dbc().replace('(0.1,0) [0|0] "A"', '(1,0) [0|0] ""')
    definitions = parse_definitions(text.encode(), "x.dbc")
    found = current_proposals(survey_bus(definitions, frames_of(peer.frames(3))), None, set())
    best = next(each for each in found if each.reading.signal.signal == "Pack_Current")
    assert not best.is_unit_given


@pytest.mark.parametrize(
    "name",
    [
        "Discharge_Current_Limit",
        "Motor_Phase_Current",
        "Max_Current",
        "Charger_Current_Setpoint",
        "Fan_Current",
        "DCL_Current",
    ],
)
def test_currents_of_other_things_come_after_that_of_the_pack(name):
    found = current_proposals(
        surveyed(("VCU", line(name, "A")), ("BMS", line("Pack_Current", "A", sign="-"))), None, set()
    )
    assert names(found)[0] == "BMS.Pack_Current"


def test_a_signal_that_is_used_already_or_of_another_unit_is_no_reading():
    found = surveyed(("BMS", line("Pack_Current", "A", sign="-")), ("X", line("Pack_Current_2", "V")))
    assert names(current_proposals(found, None, set())) == ["BMS.Pack_Current"]
    assert current_proposals(found, None, {(1, "Pack_Current")}) == []


def frames_of_volts(raw, n=5):
    return [(k * 10**8, 1, raw.to_bytes(2, "little") + bytes(6)) for k in range(n)]


@pytest.mark.parametrize(("raw", "unit"), [(400, ""), (4000, "0.1V"), (40000, "0.01V")])
def test_the_unit_of_a_pack_voltage_is_the_one_that_the_cells_sum_up_to(raw, unit):
    found = surveyed(("BMS", line("Pack_Voltage")), frames=frames_of_volts(raw))
    (best,) = pack_voltage_proposals(found, 401.0, set())
    assert best.reading.unit == unit
    assert (best.low, best.high) == pytest.approx((400.0, 400.0))
    assert "infer-pack-voltage-is" in [reason.code for reason in best.reasons]


def test_a_voltage_that_is_not_the_sum_of_the_cells_is_not_the_packs():
    right = surveyed(("BMS", line("Pack_Voltage", "V")), frames=frames_of_volts(400))
    wrong = surveyed(("BMS", line("Pack_Voltage", "V")), frames=frames_of_volts(300))
    score = [
        found[0].score if (found := pack_voltage_proposals(each, 400.0, set())) else 0.0 for each in (right, wrong)
    ]
    assert score[0] > score[1] + 5


def test_the_voltage_of_a_module_comes_after_that_of_the_pack():
    found = surveyed(("Module_1", line("Module_Voltage", "V")), ("BMS", line("Pack_Voltage", "V")))
    assert names(pack_voltage_proposals(found, float("nan"), set()))[0] == "BMS.Pack_Voltage"


@pytest.mark.parametrize(
    ("declared", "raw", "unit"),
    [
        (line("SOC", "%", 8), 64, ""),
        (line("SOC", "", 8), 64, "percent"),
        (line("Pack_SOC", "", 16), 640, "0.1percent"),
        (line("State_Of_Charge", "", 16, 0.001), 640, "fraction"),
    ],
)
def test_the_unit_of_an_soc_is_by_its_range(declared, raw, unit):
    (best,) = soc_proposals(surveyed(("BMS", declared), frames=frames_of_volts(raw)), set())
    assert best.reading.unit == unit


def test_a_signal_that_is_never_heard_comes_after_one_that_is():
    found = surveyed(
        ("BMS", line("Pack_Voltage", "V")), ("Old", line("Pack_Voltage", "V")),
        frames=[(k * 10**9, 1, (400).to_bytes(2, "little")) for k in range(10)],
    )  # fmt: skip
    assert names(pack_voltage_proposals(found, float("nan"), set()))[0] == "BMS.Pack_Voltage"


CAR = surveyed(
    ("Elcon_Status", line("Output_Voltage", "V"), line("Output_Current", "A", start=16)),
    ("Elcon_Request", line("Charger_Max_Voltage", "V"), line("Charger_Max_Current", "A", start=16)),
    ("BMS_Limits", line("Pack_DCL", "A"), line("Pack_CCL", "A", start=16)),
)
OF = {  # what proposes signals of each line
    "current": lambda found, used: current_proposals(found, None, used),
    "pack_voltage": lambda found, used: pack_voltage_proposals(found, float("nan"), used),
    "soc": soc_proposals,
    **{
        kind: lambda found, used, kind=kind: charger_proposals(found, kind, used)
        for kind in ("charger_voltage", "charger_current")
    },
    **{
        name: lambda found, used, name=name: limit_proposals(found, name, used)
        for name in ("discharge_current_max_a", "charge_current_max_a")
    },
}


@pytest.mark.parametrize(
    ("kind", "signal"),
    [
        ("charger_voltage", "Elcon_Status.Output_Voltage"),  # not what it is asked for
        ("charger_current", "Elcon_Status.Output_Current"),
        ("discharge_current_max_a", "BMS_Limits.Pack_DCL"),
        ("charge_current_max_a", "BMS_Limits.Pack_CCL"),
    ],
)
def test_what_a_charger_gives_and_limits_are_found_and_not_where_another_line_has_them(kind, signal):
    first, *others = names(OF[kind](CAR, set()))
    assert first == signal
    assert not others or kind.endswith("max_a")
    message, name = signal.split(".")
    assert signal not in names(OF[kind](CAR, {(3 if message == "BMS_Limits" else 1, name)}))


@pytest.mark.parametrize(
    ("kind", "message", "lines"),
    [
        ("current", "lvpdb_coolant", [("accumulator_fans_current", ""), ("coolant_pump_current", "")]),
        *(
            ("pack_voltage", "BMS", [(name, "V")])
            for name in ("Min_Cell_Voltage", "Voltage_Limit", "Pack_Power", "Target_Voltage", "Error_Counter")
        ),
        ("soc", "BMS", [(name, "%") for name in ("SOC_Limit", "SOC_Error", "Cell_SOC_Target", "SOH", "Socket_Temp")]),
        *(  # what a charger may give or takes from the wall
            ("charger_current", "Elcon_Status", [(name, "A")])
            for name in ("Max_Output_Current", "Output_Current_Limit", "AC_Current", "Requested_Current")
        ),
        ("charger_current", "Pumps", [("Output_Current", "A")]),  # a charger is known by its message
        ("charger_voltage", "Elcon_Status", [("Output_Current", "A")]),
        ("charger_current", "Elcon_Status", [("Output_Current", "V")]),
        *(
            ("discharge_current_max_a", "BMS", [signal])
            for signal in (
                ("Max_Discharge_Power", "kW"),
                ("Max_Discharge_Cell_Current", "A"),
                ("Discharge_Current", "A"),
                ("Discharge_Voltage_Max", "V"),
            )
        ),
    ],
)
def test_other_figures_and_those_of_other_things_are_none(kind, message, lines):
    bits = 8 if kind == "soc" else 16
    found = surveyed((message, *(line(name, unit, bits, start=bits * k) for k, (name, unit) in enumerate(lines))))
    assert OF[kind](found, set()) == []


@pytest.mark.parametrize(
    ("signal", "kind", "other"),
    [
        ("Max_Discharge_Current", "discharge_current_max_a", "charge_current_max_a"),
        ("Discharge_Current_Limit", "discharge_current_max_a", "charge_current_max_a"),
        ("Max_Charge_Current", "charge_current_max_a", "discharge_current_max_a"),
        ("Regen_Current_Allowed", "charge_current_max_a", "discharge_current_max_a"),
    ],
)
def test_a_limit_is_that_of_its_direction_only(signal, kind, other):
    found = surveyed(("BMS", line(signal, "A")))
    assert names(OF[kind](found, set())) == [f"BMS.{signal}"]
    assert OF[other](found, set()) == []


def test_what_was_heard_of_a_limit_is_shown_with_it_and_silence_speaks_against_it():
    def received(frames):
        limit = surveyed(("BMS", line("Pack_DCL", "A", factor=0.1)), frames=frames)
        return limit_proposals(limit, "discharge_current_max_a", set())

    (found,) = received([(k * 10**8, 1, (2000 + k).to_bytes(2, "little")) for k in range(11)])
    assert (found.low, found.high) == (pytest.approx(200.0), pytest.approx(201.0))
    assert received([(k * 10**9, 9, bytes(8)) for k in range(120)]) == [], "two minutes, and never heard"
