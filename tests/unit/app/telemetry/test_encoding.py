import json
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from app.telemetry import BoolArray, FloatArray
from app.telemetry.encoding import encode, is_array, plain
from app.telemetry.fields import INTERNAL, SentAs, Unit


@dataclass(frozen=True)
class Whole:
    """Nothing of it needs a change."""

    seconds: float
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Rounded:
    volts: Annotated[float | None, Unit("V", "", 2)]
    whole: Whole | None = None


@dataclass(frozen=True)
class Table:
    volts: Annotated[FloatArray, Unit("V", "", 1)]
    flags: BoolArray | None


@dataclass(frozen=True)
class Outer:
    t_ns: Annotated[int, SentAs("time", 1e9)]
    secret: Annotated[bytes, INTERNAL]
    rows: tuple[Rounded, ...]
    table: Table
    maybe: Rounded | None = None


def said(value):
    return json.loads(encode(plain(value)), parse_constant=lambda name: pytest.fail(name))


def outer(flags=None, maybe=None):
    table = Table(np.array([1.26, np.nan, np.inf]), flags)
    return Outer(1_500_000_000, b"x", (Rounded(1.239, Whole(0.1 + 0.2)),), table, maybe)


def test_names_decimals_and_what_is_not_sent_are_those_of_the_fields():
    assert said(outer()) == {
        "time": 1.5,
        "rows": [{"volts": 1.24, "whole": {"seconds": 0.1 + 0.2, "names": []}}],
        "table": {"volts": [1.3, None, None], "flags": [None] * 3},
        "maybe": None,
    }


def test_what_is_there_is_converted_and_what_is_missing_is_null():
    body = said(outer(np.array([True, False, True]), Rounded(None)))
    assert body["maybe"] == {"volts": None, "whole": None}
    assert body["table"]["flags"] == [True, False, True]


def test_infinity_and_nan_are_null_also_where_nothing_is_rounded():
    assert said(Whole(np.inf)) == {"seconds": None, "names": []}
    assert said(Rounded(np.nan)) == {"volts": None, "whole": None}


def test_a_dataclass_that_needs_no_change_is_left_to_orjson():
    whole = Whole(1.0)
    assert plain(whole) is whole


@pytest.mark.parametrize("hint", [np.ndarray[Any, np.dtype[np.float64]], NDArray[np.float64], NDArray[np.bool_]])
def test_an_array_is_known_however_numpy_spells_its_type(hint) -> None:
    assert is_array(hint)
