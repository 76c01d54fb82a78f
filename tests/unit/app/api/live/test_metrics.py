from app.api.live.metrics import _CELLS, _ENERGY, _TOTALS
from app.telemetry import Accumulator, Cells
from app.telemetry.fields import units


def test_every_metric_is_of_a_field_of_the_snapshot():
    assert {*_TOTALS, *_ENERGY} <= {name for name, _ in units(Accumulator)}
    assert _CELLS.keys() <= {name for name, _ in units(Cells)}
