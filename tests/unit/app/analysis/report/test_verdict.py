import numpy as np

from app.analysis.report.findings import odd_cells
from app.analysis.report.verdict import verdicts
from app.analysis.survey import Survey
from app.words import sentence

CELL = 30  # pack 3, cell 7


def survey(**of_cell):
    """A run of 50 % of the charge with sound cells; `of_cell` are what one cell shows instead."""
    rng = np.random.default_rng(3)
    made = Survey(
        96,
        samples=12000,
        driving_s=900.0,
        soc_first=np.full(96, 0.9),
        soc_last=0.4 + rng.normal(0, 0.002, 96),
        resistance_ohm=0.0018 + rng.normal(0, 2e-5, 96),
        temperature_max_degc=np.full(96, 36.0),
        lowest_s=np.full(96, 9.0),
        sag_v=np.zeros(96),
        missing=np.zeros(96),
    )
    for name, value in of_cell.items():
        getattr(made, name)[CELL] = value
    return made


def said(made, tripped=(CELL,), loose=()):
    return [sentence(each, [12] * 8).text for each in verdicts(made, odd_cells(made), tripped, loose)]


def test_a_cell_that_used_more_of_its_charge_has_lost_capacity():
    (why,) = said(survey(soc_last=0.15, resistance_ohm=0.0027), loose=[CELL])
    assert why.startswith("Pack 3, cell 7 has lost capacity: it used 75 % of its charge, the others 50 %")
    assert "holds about 67 % of what they hold" in why
    assert "resistance is 50 % higher" in why
    assert "Replace the module" in why


def test_resistance_alone_is_a_joint_and_not_the_cell():
    (why,) = said(survey(resistance_ohm=0.0028), loose=[CELL])
    assert "has 1.00 m\u03a9 more resistance than the others, while its charge fell as theirs did" in why
    assert "not the cell" in why
    assert "bolts" in why


def test_resistance_in_a_run_too_short_to_tell_leaves_the_cell_in_question():
    made = survey(resistance_ohm=0.0028)
    made.soc_last = made.soc_first - 0.02
    (why,) = said(made)
    assert "a joint, a sense wire or the cell" in why


def test_a_cell_that_only_began_lower_is_to_be_balanced():
    (why,) = said(survey(soc_first=0.8, soc_last=0.3))
    assert why == "Pack 3, cell 7 began 10 % below the others and used what they used: balance it."


def test_a_trip_of_a_cell_that_is_like_the_others_points_at_the_measurement():
    assert "sense wire" in said(survey(missing=600.0))[0]
    assert "nothing says that the cell is at fault" in said(survey())[0]


def test_without_a_trip_or_a_cell_that_stands_out_nothing_is_explained():
    assert said(survey(), tripped=()) == []


def test_what_was_not_estimated_is_not_taken_for_lost_capacity():
    made = survey(resistance_ohm=0.0028)
    made.soc_first[:] = np.nan
    assert "or the cell" in said(made)[0]
