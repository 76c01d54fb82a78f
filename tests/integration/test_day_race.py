"""A day of racing at speed: what the line carried is what the session holds."""

from pathlib import Path

from tests.campaign import campaign, of_size
from tests.recorded.day_race import DayRace, check

SECONDS = of_size(20, 180, 1800, 4 * 3600)


@campaign(240, 600, 1700)
def test_a_race_simulated_at_speed_is_recorded_whole(tmp_path: Path, capsys, tell) -> None:
    race = DayRace(tmp_path, "race-day")
    race.hour(SECONDS)
    race.close()
    assert race.sent > 400
    assert check(race) == []
    soc = f"charge of every cell within {100 * race.worst_soc:.1f} %"
    tell(f"day race: {SECONDS / 3600:.2g} h of racing, {race.sent} frames recorded, none missing or changed, {soc}")
    race.digest.update(b"one frame more")
    assert any("not the same bytes" in each for each in check(race))
