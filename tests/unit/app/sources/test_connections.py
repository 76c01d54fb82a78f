"""What to read, as chosen on a page."""

import json

import pytest

from app.errors import ConfigError, NotNow
from app.sources.connections import FILE, Connections, Setup, buses_of, load_connections, save_connections

ORION = Connections(can="socketcan:can0", battery="orion-bms-2")
PROFILE = b"""
[battery]
name = "two cells"
segments = [2]

[source]
dbc = "two.dbc"

[[source.voltage]]
signal = "V{cell}"
base = 1
"""
DBC = b"""VERSION ""
NS_ :
BS_:
BU_: BMS
BO_ 256 Cells: 4 BMS
 SG_ V1 : 0|16@1+ (0.001,0) [0|5] "V" BMS
 SG_ V2 : 16|16@1+ (0.001,0) [0|5] "V" BMS
"""


def test_what_was_kept_is_what_is_read_again(tmp_path):
    assert load_connections(tmp_path) is None
    save_connections(tmp_path, ORION)
    assert load_connections(tmp_path) == ORION


@pytest.mark.parametrize("text", ["[]", '{"serial": 7}', '{"port": "COM6"}', "not json"])
def test_a_file_that_is_no_choice_is_an_error_that_names_it(tmp_path, text):
    (tmp_path / FILE).write_text(text)
    with pytest.raises(ConfigError, match=FILE):
        load_connections(tmp_path)


def test_nothing_is_needed_once_something_was_chosen_or_the_command_line_says_it(tmp_path):
    assert Setup(tmp_path, Connections(), fixed=False).is_needed
    assert not Setup(tmp_path, Connections(), fixed=True).is_needed
    save_connections(tmp_path, Connections())
    assert not Setup(tmp_path, Connections(), fixed=False).is_needed


def test_a_choice_is_kept_and_starts_the_service_again(tmp_path):
    started = []
    setup = Setup(tmp_path, Connections(), fixed=False)
    setup.on_choice = lambda: started.append(load_connections(tmp_path))
    setup.choose(ORION)
    assert started == [ORION]


@pytest.mark.parametrize(
    ("choice", "field"),
    [
        (Connections(serial="foo://bar"), "serial"),
        (Connections(can="can0"), "can"),
        (Connections(battery="no such one"), "battery"),
        (Connections(serial="COM6", battery="orion-bms-2"), "serial"),
    ],
)
def test_what_cannot_work_is_refused_by_its_field_and_not_kept(tmp_path, choice, field):
    setup = Setup(tmp_path, Connections(), fixed=False)
    with pytest.raises(ConfigError, match=field):
        setup.choose(choice)
    assert load_connections(tmp_path) is None


def test_the_command_line_wins(tmp_path):
    with pytest.raises(NotNow):
        Setup(tmp_path, Connections(), fixed=True).choose(ORION)


def test_an_uploaded_profile_can_be_chosen(tmp_path):
    setup = Setup(tmp_path, Connections(), fixed=False)
    name = setup.upload({"two.dbc": DBC, "two.toml": PROFILE})
    assert setup.batteries()[name].battery.n_cells == 2
    setup.choose(Connections(battery=name))
    assert json.loads((tmp_path / FILE).read_text())["battery"] == name


@pytest.mark.parametrize(
    "files",
    [
        {"two.dbc": DBC},
        {"../two.toml": PROFILE, "two.dbc": DBC},
        {"two.toml": PROFILE},
        {"two.toml": b"[battery]", "two.dbc": DBC},
    ],
)
def test_an_upload_that_is_no_battery_is_refused_and_not_kept(tmp_path, files):
    setup = Setup(tmp_path, Connections(), fixed=False)
    with pytest.raises(ConfigError):
        setup.upload(files)
    assert not list(tmp_path.rglob("*.toml"))


@pytest.mark.parametrize(
    ("urls", "expected"),
    [
        (None, []),
        ("socketcan:can0", ["socketcan:can0"]),
        ("socketcan:can0,socketcan:can1", ["socketcan:can0", "socketcan:can1"]),
        ("vector:0,1,slcan:/dev/ttyACM0?bitrate=250000", ["vector:0,1", "slcan:/dev/ttyACM0?bitrate=250000"]),
        ("slcan:socket://a:1?timeout=0.05,pcan:PCAN_USBBUS1", ["slcan:socket://a:1?timeout=0.05", "pcan:PCAN_USBBUS1"]),
    ],
)
def test_buses_stand_behind_commas_and_a_channel_may_hold_one(urls, expected):
    assert buses_of(urls) == expected


def test_more_buses_than_frames_can_be_told_apart_of_are_refused():
    with pytest.raises(ConfigError, match="at most 4 buses"):
        buses_of(",".join(f"virtual:{i}" for i in range(5)))


def test_every_bus_has_to_be_one():
    with pytest.raises(ConfigError, match="nothing"):
        Connections(can="virtual:a,nothing:b", battery="orion-bms-2").check()
