"""The energy a lap that is planned after three laps of 22 km is what the simulator's battery can give."""

import pytest

from app.estimation.prediction.energy_target import RacePlan
from tests.campaign import SIZE, campaign
from tests.numeric.prediction_races import RaceRun, possible_lap_wh

LAPS, RESERVE, WITHIN = 22, 0.1, 0.05


@pytest.mark.skipif(SIZE != "long", reason="each race is driven to its end several times: in the long campaign")
@campaign(60, 60, 1800)
@pytest.mark.parametrize(("scenario", "seed"), [("clean-endurance", 51), ("clean-endurance", 54)])
def test_the_plan_at_lap_three_is_what_was_possible(scenario, seed, tell):
    run = RaceRun(scenario, seed, 10.0, plan=RacePlan(LAPS, RESERVE))
    targets = ((probe, probe.prediction.target) for probe in run.probes)
    probe, target = next((p, t) for p, t in targets if t is not None and t.laps_to_go == LAPS - 3)
    assert target.counted_by == "marks"
    possible_wh = possible_lap_wh(run, probe, RESERVE) + target.used_wh / target.laps_to_go
    assert target.lap_energy_wh == pytest.approx(possible_wh, rel=WITHIN)
    tell(f"energy a lap planned at lap 3, {scenario} {seed}: {target.lap_energy_wh:.0f} of {possible_wh:.0f} Wh")
