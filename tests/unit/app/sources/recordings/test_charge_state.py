import numpy as np
import pytest

from app.sources.recordings.battery_log import battery_log
from app.sources.recordings.charge_state import signed, state_of, tells_state
from app.sources.recordings.dataset import load_recording
from app.sources.recordings.guess import guess
from app.sources.recordings.table import load_table

MACCOR = "Rec#\tTestTime\tAmps\tVolts\tState\n" + "".join(
    f"{k}\t{k}.0\t{1.0 if state in 'CD' else 0.0}\t{3.7 + 0.05 * ((state == 'C') - (state == 'D'))}\t{state}\n"
    for k, state in enumerate("RDDDRCCCR", 1)
)


@pytest.mark.parametrize("word", ["D", "DCH", "Dchg", "CC DChg", "CC_DChg", "Discharge", "discharging"])
def test_words_for_discharge(word: str) -> None:
    assert state_of(word) == -1.0


@pytest.mark.parametrize("word", ["C", "CHA", "CC Chg", "CCCV_Chg", "Charge", "charging"])
def test_words_for_charge(word: str) -> None:
    assert state_of(word) == 1.0


@pytest.mark.parametrize("word", ["R", "PAU", "Rest", "Idle", "Pause", "S", "", "CV"])
def test_other_words_are_neither(word: str) -> None:
    assert state_of(word) == 0.0


def test_a_current_without_a_sign_gets_that_of_its_state(tmp_path) -> None:
    path = tmp_path / "maccor.txt"
    path.write_text(MACCOR)
    table = load_table(path)
    expected = [0, 1, 1, 1, 0, -1, -1, -1, 0]
    np.testing.assert_array_equal(battery_log(table, guess(table)).current_a, expected)
    for charge_positive in (False, True):
        recording = load_recording(path, charge_positive=charge_positive)
        np.testing.assert_array_equal(recording.current_a, expected)
        assert any("State says" in note for note in recording.notes)


def test_a_current_with_a_sign_keeps_it() -> None:
    current, state = np.array([1.0, -1.0]), np.array([1.0, -1.0])
    assert signed(current, {"State": state}) == (pytest.approx(current), None)
    assert signed(np.abs(current), {"Other": state})[1] is None
    assert tells_state("Step Type")
    assert not tells_state("Estate")
