import xml.etree.ElementTree as ET

import numpy as np
import pytest

from app.analysis.printed.svg import Band, Bars, Line, Mark, Rule, chart, ticks


def numbers(path):
    return [tuple(map(float, point.split())) for point in path.replace("M", "L").strip("LZ").split("L")]


def test_no_dip_is_lost_however_long_the_recording():
    y = np.full(200_000, 3.7)
    y[123_456] = 2.4
    drawn = ET.fromstring(chart("V", [Line("cell", np.arange(200_000.0), y)], rules=[Rule("limit", 2.5)]))
    points = numbers(drawn.findall("path[@fill='none']")[0].get("d"))
    assert len(points) < 2000
    limit_y = float(drawn.find("path[@stroke-dasharray]").get("d").split()[1].partition("H")[0])
    assert max(y for _, y in points) > limit_y  # down is more


def test_a_gap_stays_a_gap():
    y = np.array([1.0, 2.0, np.nan, 2.0, 1.0])
    drawn = ET.fromstring(chart("V", [Line("", np.arange(5.0), y)]))
    assert drawn.find("path[@fill='none']").get("d").count("M") == 2


def test_names_are_escaped_and_anything_empty_is_still_a_picture():
    text = chart("<V>", [Line("<&>", np.arange(3.0), np.ones(3))], marks=[Mark("<m>", 1.0)], name='"x"')
    ET.fromstring(text)
    nothing = np.empty(0)
    ET.fromstring(chart("V", [Line("a", nothing, nothing)], bands=[Band("b", nothing, nothing, nothing)]))
    ET.fromstring(chart("V", [Line("a", np.arange(3.0), np.full(3, np.nan))]))
    ET.fromstring(chart("%", bars=[Bars(np.arange(4.0), np.array([1.0, 0.0, 2.0]))]))


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-10.0, 5.0), (2.4, 4.21), (0.0, 1e-4), (0.0, 3e6)])
def test_ticks_are_round_and_few(low, high):
    found = ticks(low, high, 5)
    assert 2 <= len(found) <= 6
    assert min(found) >= low - 1e-9 * (high - low)
    assert max(found) <= high + 1e-9 * (high - low)
    assert ticks(3.0, 3.0, 5) == [3.0]
