"""Families of signals as teams name them: number of cells, order, unit and segments are found."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.infer.bus_survey import survey_bus
from app.sources.dbc.infer.families import family_proposals
from tests.campaign import examples
from tests.peer_messages import HEAD, Bits, Peer, Sent, fixed, others
from tests.unit.app.sources.dbc.infer.test_inference import (
    assert_cells_decode,
    assert_learned_rightly,
    learned_of,
)

RUNNING = (
    "Cell{c}_Voltage",
    "CellVoltage{c:02d}",
    "V_Cell_{c:03d}",
    "cellVolt{c}",
    "Zelle{c}_U",
    "CV{c}",
    "BMS_Cell_{c}_mV",
)
OF_SEGMENTS = (
    "Seg{s}_Cell{c}",
    "SEG_{S}_CELL_{c:02d}",
    "Module{s}Cell{c}Voltage",
    "Stack_{s}_V{c}",
    "Slave{s:02d}_CellV_{c:02d}",
)
UNITS = (("V", 1.0, 0.0001), ("mV", 1000.0, 1.0), ("", 1000.0, 1.0), ("", 1e4, 1.0), ("V", 1e4, 1.0))


@st.composite
def peers(draw, with_segments):
    """A battery of four voltages a frame, and on the same bus what could be taken for cells."""
    n_packs, size = draw(st.integers(2, 5)), draw(st.integers(6, 14))
    pattern = draw(st.sampled_from(OF_SEGMENTS if with_segments else RUNNING))
    unit, per_volt, factor = draw(st.sampled_from(UNITS))
    base_s, base_c, order = draw(st.integers(0, 1)), draw(st.integers(0, 1)), draw(st.integers(0, 1))
    n = n_packs * size
    peer = Peer(pattern, n, 0, segments=(size,) * n_packs if with_segments else None, resolution_v=factor / per_volt)
    peer.positive = draw(st.sampled_from(["discharge", "charge"]))

    def name(i):
        if not with_segments:
            return pattern.format(c=i + base_c)
        s, c = divmod(i, size)
        return pattern.format(s=s + base_s, S="ABCDE"[s], c=c + base_c)

    for f, first in enumerate(range(0, n, 4)):
        bits = [
            Bits(
                name(i), 16 * k if order else 16 * k + 7, 16,
                lambda t, i=i: peer.voltage(i, t) * per_volt, factor, unit=unit, order=order,
            )
            for k, i in enumerate(range(first, min(first + 4, n)))
        ]  # fmt: skip
        peer.sent.append(Sent(0x120 + f, f"AMS_Cells_{f}", 8, 0.4, [bits]))
    peer.sent += others(peer)
    return peer


@settings(max_examples=examples(25))
@given(peers(with_segments=False))
def test_cells_that_are_numbered_in_one_run_are_found_with_their_unit_and_order(peer):
    inferred = assert_learned_rightly(peer, 15.6)
    assert "infer-segments-guessed" in [question.code for question in inferred.questions]


@settings(max_examples=examples(25))
@given(peers(with_segments=True))
def test_cells_that_are_numbered_by_segment_are_found_with_their_segments(peer):
    inferred = assert_learned_rightly(peer, 15.6)
    assert "infer-segments-guessed" not in [question.code for question in inferred.questions]


def proposals(text, kind="voltage", frames=()):
    definitions = parse_definitions((HEAD + text).encode(), "x.dbc")
    found = family_proposals(survey_bus(definitions, frames_of(list(frames))), kind)
    return sorted(found, key=lambda each: -each.score)


def signals(names, unit="V", factor=0.0001, bits=16, mux=""):
    return "".join(
        f' SG_ {name}{mux} : {bits * k}|{bits}@1+ ({factor},0) [0|0] "{unit}" X\n' for k, name in enumerate(names)
    )


def message(can_id, name, text, length=8):
    return f"BO_ {can_id} {name}: {length} BMS\n{text}"


def entry_of(text, kind="voltage"):
    (entry,) = proposals(text, kind)[0].entries
    return entry


def test_the_message_is_named_where_signals_of_others_would_fit_too():
    cells = "".join(message(1 + m, f"Module_{m}", signals([f"V{k}" for k in range(4)])) for m in range(3))
    alike = message(9, "Charger", signals(["V1", "V2"], "A"))
    assert entry_of(cells + alike).message == "Module_{pack}"


def test_a_bit_beside_each_cell_that_says_invalid_is_its_flag():
    values = signals([f"Cell{k}_V" for k in range(1, 5)], factor=0.001, bits=12)
    flags = "".join(f' SG_ Cell{k}_Invalid : {47 + k}|1@1+ (1,0) [0|1] "" X\n' for k in range(1, 5))
    assert entry_of(message(1, "M", values + flags)).invalid_signal == "Cell{cell}_Invalid"
    some = "".join(f' SG_ Cell{k}_Invalid : {47 + k}|1@1+ (1,0) [0|1] "" X\n' for k in range(1, 4))
    assert entry_of(message(1, "M", values + some)).invalid_signal == ""


def test_messages_with_the_same_signals_are_taken_by_their_ids_and_that_is_said():
    cells = "".join(message(0x30 - i, f"N{'XYZ'[i]}x", signals([f"CellV{k}" for k in range(4)])) for i in range(3))
    best = proposals(cells)[0]
    assert [(entry.message, entry.first) for entry in best.entries] == [("NZx", 0), ("NYx", 4), ("NXx", 8)]
    assert [reason.code for reason in best.reasons] == ["infer-by-id"]
    assert best.n == 12


@pytest.mark.parametrize(
    "names",
    [
        [f"Min_Cell_Voltage_{k}" for k in range(4)],
        [f"Cell_OverVoltage_Limit_{k}" for k in range(4)],
        [f"Motor_Voltage_{k}" for k in range(4)],
        [f"Balancing_Cell_{k}" for k in range(4)],
        [f"Cell_{k}_V" for k in range(3)],  # too few of them
    ],
)
def test_figures_of_cells_are_no_cells(names):
    assert proposals(message(1, "M", signals(names))) == []
    assert proposals(message(1, "M", signals(["Cell_Temp_1", "Cell_Temp_2"], "degC")), "temperature")[0].n == 2


def test_cells_that_read_what_no_cell_reads_score_less_than_those_that_do():
    text = message(1, "M", signals([f"Cell_{k}_V" for k in range(4)])) + message(
        2, "N", signals([f"Cell_{k}_X_V" for k in range(4)])
    )
    good, bad = (37000).to_bytes(2, "little") * 4, (60000).to_bytes(2, "little") * 4
    found = proposals(text, frames=[(t, can_id, data) for t in range(5) for can_id, data in ((1, bad), (2, good))])
    assert found[0].entries[0].signal == "Cell_{cell}_X_V"
    assert found[1].score < 6.0


@pytest.mark.parametrize("gap", [3, 7])
def test_a_cell_that_the_dbc_does_not_have_keeps_its_number(gap):
    best = proposals(message(1, "M", signals([f"Cell_{k}_V" for k in range(9) if k != gap], bits=8, factor=0.02)))[0]
    assert best.n == 9
    assert best.entries[0].base == {}


@st.composite
def heated(draw):
    """A battery with temperatures of any number, name, base and scale beside its cells and those of the motor."""
    peer = Peer("heat", 24, draw(st.integers(4, 30)), segments=None)
    for f in range(6):
        bits = [
            Bits(f"Cell{4 * f + k}_V", 16 * k, 16, lambda t, i=4 * f + k: peer.voltage(i, t), 0.0001, unit="V")
            for k in range(4)
        ]
        peer.sent.append(Sent(0x120 + f, f"Cells_{f}", 8, 0.4, [bits]))
    pattern = draw(st.sampled_from(["Cell_Temp_{}", "Temp{:02d}", "NTC_{}", "Therm{}_T", "Zelle{}_Temperatur"]))
    unit, factor, offset, bits = draw(
        st.sampled_from(
            [("degC", 1, -40, 8), ("C", 0.5, -40, 8), ("degC", 0.1, 0, 16), ("K", 0.1, 0, 16), ("", 1, 0, 8)]
        )
    )
    zero = 273.15 if unit == "K" else 0.0
    base, a_frame = draw(st.integers(0, 1)), 64 // bits
    for f, first in enumerate(range(0, peer.n_sensors, a_frame)):
        signals_of = [
            Bits(
                pattern.format(i + base), bits * k, bits, lambda t, i=i: peer.temperature(i, t) + zero,
                factor, offset, unit,
            )
            for k, i in enumerate(range(first, min(first + a_frame, peer.n_sensors)))
        ]  # fmt: skip
        peer.sent.append(Sent(0x180 + f, f"Temps_{f}", 8, 0.5, [signals_of]))
    peer.sent += others(peer)
    return peer


@settings(max_examples=examples(20))
@given(heated())
def test_temperatures_of_any_number_name_and_unit_are_found_and_those_of_the_motor_are_not(peer):
    _, found = assert_cells_decode(peer, *learned_of(peer, 3))
    assert set(found["temperature"].index.tolist()) == set(range(peer.n_sensors))


@st.composite
def paged(draw):
    """A battery under a multiplexer, of any width of its values, with or without numbers that begin with one."""
    width, unit = draw(st.sampled_from([(16, ("V", 1.0, 0.0001)), (16, ("mV", 1000.0, 1.0)), (12, ("V", 1.0, 0.002))]))
    k = draw(st.integers(1, 48 // width))
    pages, base = draw(st.integers(6, 24)), draw(st.integers(0, 1))
    unit_text, per_volt, factor = unit
    peer = Peer("paged", k * pages, 0, resolution_v=factor / per_volt)
    pattern = draw(st.sampled_from(["CellV_{}", "Cell{:03d}_Voltage", "VCell{}", "U_Zelle_{}"]))
    turns = []
    for page in range(pages):
        bits = [Bits("Mux", 0, 8, fixed(page), is_mux=True)]
        for j in range(k):
            i = k * page + j
            bits.append(
                Bits(
                    pattern.format(i + base), 8 + width * j, width,
                    lambda t, i=i: peer.voltage(i, t) * per_volt, factor, unit=unit_text, mux=page,
                )
            )  # fmt: skip
        turns.append(bits)
    can_id = draw(st.sampled_from([0x220, 0x80000000 | 0x18FF0001]))
    peer.sent = [Sent(can_id, "BMS_Cell_Pages", 8, 0.02 * pages, turns), *others(peer)]
    return peer


@settings(max_examples=examples(20))
@given(paged())
def test_cells_under_a_multiplexer_of_any_width_are_found_and_it_is_named(peer):
    reasons = assert_learned_rightly(peer, 13).lines["voltage"].chosen.reasons
    assert "infer-multiplexed" in [reason.code for reason in reasons]


@pytest.mark.parametrize("sizes", [(12, 12, 11), (7, 8), (10, 12, 14, 12)])
def test_segments_of_different_sizes_keep_their_sizes(sizes):
    text = "".join(
        message(1 + s, f"Seg{s + 1}", signals([f"Seg{s + 1}_Cell{k + 1}" for k in range(size)], bits=16), 64)
        for s, size in enumerate(sizes)
    )
    best = proposals(text)[0]
    assert (best.n, best.segments) == (sum(sizes), sizes)
    assert best.entries[0].base == {"pack": 1, "cell": 1}


@pytest.mark.parametrize("ids", [[0x30, 0x20, 0x10], [0x10, 0x20, 0x30]])
def test_names_count_and_not_ids_nor_the_order_of_the_file(ids):
    text = "".join(
        message(can_id, f"Frame{f}", signals([f"Cell_{4 * f + k}_V" for k in range(4)])) for f, can_id in enumerate(ids)
    )
    best = proposals(text)[0]
    assert (best.n, best.entries[0].signal, best.entries[0].base) == (12, "Cell_{cell}_V", {})
    assert [signal.name for _, signal in best.members] == [f"Cell_{k}_V" for k in range(12)]


def test_balancing_bits_are_a_family_of_their_own():
    bits = "".join(f' SG_ Balance_Cell_{k} : {k}|1@1+ (1,0) [0|1] "" X\n' for k in range(1, 13))
    best = proposals(message(1, "M", bits), "balancing")[0]
    assert (best.n, best.entries[0].signal) == (12, "Balance_Cell_{cell}")


def of_modules(n_modules, here, silent=()):
    """A DBC of modules with 12 cells under a multiplexer each, and the frames of those that are `here`."""
    peer = Peer("modules", 12 * len(here), 0, resolution_v=0.001)
    text = HEAD
    for m in range(n_modules):
        turns = [
            [Bits("Cell_Idx", 0, 4, fixed(p), is_mux=True)]
            + [
                Bits(
                    f"Cell{3 * p + k + 1}", 8 + 12 * k, 12,
                    lambda t, i=12 * m + 3 * p + k: 1000 * peer.voltage(i, t), 1, 405, mux=p,
                )
                for k in range(3)
            ]
            for p in range(4)
        ]  # fmt: skip
        sent = Sent(0x400 + m, f"BMS_TX_CMD_{m + 1}", 6, 0.4, turns)
        text += sent.lines()
        if m in here:
            spoken = [turn for p, turn in enumerate(turns) if (m, p) not in silent]
            peer.sent.append(Sent(0x400 + m, f"BMS_TX_CMD_{m + 1}", 6, 0.4, spoken))
    received = survey_bus(parse_definitions(text.encode(), "x.dbc"), frames_of(peer.frames(8.0)))
    return max(family_proposals(received, "voltage"), key=lambda each: each.score)


def test_modules_that_never_spoke_in_a_log_are_not_there():
    best = of_modules(8, range(5))
    assert (best.n, best.segments) == (60, (12,) * 5)
    assert [(r.code, r.args["n"]) for r in best.reasons if r.code == "infer-never-received"] == [
        ("infer-never-received", 36)
    ]


@pytest.mark.parametrize(("here", "silent"), [((0, 1, 3), ()), (range(4), {(2, 1)})])
def test_a_module_or_cells_that_are_silent_among_others_are_missing(here, silent):
    assert of_modules(4, here, silent).n == 48
