import numpy as np
import pytest

from app.sources.recordings.battery_log import battery_log
from app.sources.recordings.dataset import load_recording
from app.sources.recordings.guess import guess
from app.sources.recordings.quantities import charges_positive, signed, state_of, tells_state
from app.sources.recordings.table import load_table

MACCOR = "Rec#\tTestTime\tAmps\tVolts\tState\n" + "".join(
    f"{k}\t{k}.0\t{1.0 if state in 'CD' else 0.0}\t{3.7 + 0.05 * ((state == 'C') - (state == 'D'))}\t{state}\n"
    for k, state in enumerate("RDDDRCCCR", 1)
)


@pytest.mark.parametrize(
    ("words", "sign"),
    [
        (["D", "DCH", "Dchg", "CC DChg", "CC_DChg", "恒流放电", "Discharge", "discharging"], -1.0),
        (["C", "CHA", "CC Chg", "CCCV_Chg", "恒流恒压充电", "Charge", "charging"], 1.0),
        (["R", "PAU", "Rest", "Idle", "Pause", "S", "", "CV"], 0.0),
    ],
)
def test_words_for_charge_and_discharge(words: list[str], sign: float) -> None:
    assert {word: state_of(word) for word in words} == dict.fromkeys(words, sign)


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
    assert tells_state("工步类型")
    assert not tells_state("Estate")


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_the_sign_is_told_by_steps_and_by_the_course_of_a_slow_test(turn) -> None:
    rng = np.random.default_rng(3)
    steps = np.tile(np.repeat([0.0, 2.0, -1.0], 20), 4)
    assert charges_positive(turn * steps, 3.7 + 0.02 * steps) == (turn > 0)
    slow = np.full(5000, -0.05)  # a meter of 1 mV that moves once in ten rows
    falling = np.round(np.linspace(4.1, 3.6, 5000) + rng.normal(0, 0.0005, 5000), 3)
    assert charges_positive(turn * slow, falling) == (turn > 0)


def test_nothing_is_turned_by_rows_that_tell_nothing() -> None:
    assert not charges_positive(np.zeros(9), np.linspace(3.6, 3.7, 9))
    assert not charges_positive(np.full(9, 1.0), np.full(9, np.nan))
    assert not charges_positive(np.array([1.0]), np.array([3.7]))
    assert not charges_positive(np.ones(5000), 3.7 + np.random.default_rng(1).normal(0, 0.01, 5000))


def test_the_estimator_turns_a_file_that_counts_charging_as_positive_and_says_so(tmp_path) -> None:
    path = tmp_path / "arbin.csv"
    path.write_text(
        "Test_Time(s),Current(A),Voltage(V)\n" + "".join(f"{k},-1.5,{4.1 - 0.002 * k:.3f}\n" for k in range(100))
    )
    for charge_positive in (False, True):
        recording = load_recording(path, charge_positive=charge_positive)
        assert set(recording.current_a) == {1.5}
        assert any("sign turned" in note for note in recording.notes)
