"""The long race of the benchmarks, cut short: what the line carried is what the session holds."""

from pathlib import Path

from tests.recorded.day_race import DayRace, check


def test_a_race_simulated_at_speed_is_recorded_whole(tmp_path: Path, capsys) -> None:
    race = DayRace(tmp_path, "race-day")
    race.hour(20.0)
    race.close()
    assert race.sent > 400
    assert check(race) == []
    race.digest.update(b"one frame more")
    assert any("not the same bytes" in each for each in check(race))
