import pytest

from app.errors import ConfigError
from app.sessions.recording.session_names import RecordingPlan, checked, load_plan, next_part


def test_a_clock_that_was_never_set_gives_no_time():
    assert RecordingPlan(event="Test day").name(60 * 10**9) == "Test day before the clock was set"
    assert RecordingPlan().name(1_790_000_000 * 10**9).startswith("2026-09-2")


def test_parts_are_counted():
    assert next_part("Test day") == "Test day, part 2"
    assert next_part("Test day, part 9") == "Test day, part 10"


@pytest.mark.parametrize("kept", ["", "[]", "not json", '{"wheels": 4}'])
def test_a_damaged_file_is_an_empty_plan(tmp_path, kept):
    path = tmp_path / "recording.json"
    path.write_text(kept)
    assert load_plan(path) == RecordingPlan()


def test_a_text_that_is_too_long_is_named():
    with pytest.raises(ConfigError, match="driver"):
        checked(RecordingPlan(driver="x" * 61))
