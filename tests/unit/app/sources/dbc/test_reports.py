"""Inputs after public reports: what `battery check` and `battery learn` say of each."""

from pathlib import Path

import numpy as np
import pytest

from app.battery.library import load_profile
from app.battery.profile import read_document, understand
from app.errors import ImportFailed
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.check import issues_of
from app.sources.dbc.dbc_file import load_definitions
from app.sources.dbc.frames import load_log, load_log_of_bus
from app.sources.dbc.infer.profile_draft import Correction, ProfileDraft
from app.sources.dbc.infer.profile_text import profile_text

REPORTS = Path(__file__).with_name("reports")


def codes_of(profile, log, dbc=None, text=None, bus=""):
    """The findings of `check`, in their order."""
    loaded = load_profile(str(REPORTS / profile)).profile if text is None else text
    definitions = load_definitions(REPORTS / (dbc or Path(loaded.source.dbc[0]).name))
    frames = load_log_of_bus(REPORTS / log, definitions, bus)
    found = issues_of(loaded.battery, loaded.source, definitions, profile, frames)
    return [issue.what.code for issue in found]


def learned(dbc, log):
    definitions = load_definitions(REPORTS / dbc)
    draft = ProfileDraft(definitions, (dbc,), load_log(REPORTS / log), "x")
    inferred, issues = draft.inferred(Correction())
    profile = understand(read_document(profile_text(inferred), "x.toml", lambda name: None))
    return profile, inferred, [issue.what.code for issue in issues], definitions


@pytest.mark.parametrize(
    ("profile", "log", "dbc", "expected"),
    [
        ("mini.toml", "ref.log.gz", None, []),
        ("wrong-sign.toml", "ref.log.gz", None, ["check-wrong-sign"]),
        ("mini.toml", "ref.log.gz", "unsigned.dbc", ["check-unsigned-current"]),
        ("numbered.toml", "numbered.log.gz", None, []),
        ("short-ids.toml", "short-ids.txt.gz", None, []),
    ],
)
def test_check_names_what_the_log_shows_and_nothing_else(profile, log, dbc, expected):
    assert codes_of(profile, log, dbc) == expected


def test_two_buses_with_one_id_are_never_decoded_as_one():
    with pytest.raises(ImportFailed, match="can0, can1"):
        codes_of("mini.toml", "two-buses.log.gz")
    assert codes_of("mini.toml", "two-buses.log.gz", bus="can0") == []


def test_cells_that_multiplexed_frames_number_are_learned():
    profile, _, _, definitions = learned("numbered-mux.dbc", "numbered.log.gz")
    assert profile.battery.n_cells == 12
    voltages = BatteryDecoder(profile.battery, profile.source, definitions).decode(
        load_log(REPORTS / "numbered.log.gz")
    )["voltage"]
    first = dict(zip(voltages.index[:12].tolist(), voltages.value[:12].tolist(), strict=True))
    assert first == {cell: pytest.approx(3.8 - 0.002 * cell) for cell in range(12)}


def test_units_in_the_names_of_messages_are_packs():
    profile, _, issues, definitions = learned("tap-in-unit.dbc", "tap-in-unit.log.gz")
    assert profile.battery.segments == (5,) * 6
    assert issues == []
    frames = load_log(REPORTS / "tap-in-unit.log.gz")
    voltages = BatteryDecoder(profile.battery, profile.source, definitions).decode(frames)["voltage"]
    of_units = frames.part(np.flatnonzero(frames.can_id != 0x40))
    data = of_units.data.astype(int)
    assert voltages.index.tolist() == (5 * (of_units.can_id.astype(int) - 0x20) + data[:, 0]).tolist()
    assert voltages.value == pytest.approx((data[:, 1] + 256 * data[:, 2]) / 1000)


UNITS_AS_ONE = """
[battery]
name = "x"
segments = [5]
[battery.temperatures]
sensors = 0
[source]
dbc = "tap-in-unit.dbc"
[[source.voltage]]
message = "{message}"
signal = "Cell_Volt_Value"
numbers = {{ cell = "Tap_No" }}
[source.current]
signal = "Pack_Amps.Battery_Current"
"""


@pytest.mark.parametrize(("message", "code"), [("Unit*_CellVolt", "check-two-messages"), ("Unit5*", "check-not-read")])
def test_thirty_cells_that_are_read_as_five_are_a_finding(message, code):
    profile = understand(read_document(UNITS_AS_ONE.format(message=message), "x.toml", lambda name: None))
    assert codes_of("x.toml", "tap-in-unit.log.gz", "tap-in-unit.dbc", profile) == [code]


def test_a_current_that_wraps_is_named_where_it_is_learned_with_the_sign_of_its_steps():
    profile, inferred, issues, _ = learned("unsigned.dbc", "ref.log.gz")
    assert issues == ["check-unsigned-current"]
    assert profile.source.current.positive == "discharge"
    assert "infer-unsigned" in [reason.code for reason in inferred.lines["current"].chosen.reasons]


def test_a_signal_that_was_1_4_and_8_was_not_8_all_the_time():
    _, inferred, _, _ = learned("states.dbc", "states.log.gz")
    reasons = {key: line.chosen.reasons for key, line in inferred.lines.items() if key.startswith("state.")}
    assert "infer-state-constant" not in {reason.code for each in reasons.values() for reason in each}
    (never,) = [reason for reason in reasons["state.fault"] if reason.code == "infer-state-never"]
    assert never.args["values"] == "1, 4, 8"
