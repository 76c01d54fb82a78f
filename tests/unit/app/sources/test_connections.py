"""What to read, as chosen on a page."""

import json
from pathlib import Path

import pytest

from app.errors import ConfigError, NotNow
from app.sources.connections import FILE, Connections, Setup, load_connections, save_connections

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
FILES = {"two.dbc": DBC, "two.toml": PROFILE}


@pytest.fixture
def setup(tmp_path):
    return Setup(tmp_path, Connections(), fixed=False)


@pytest.fixture
def written(tmp_path):
    """A profile on the disk that nobody uploaded."""
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path / "two.toml"


@pytest.mark.parametrize(
    "content",
    [
        b"[]", b"", b'{"serial": 7}', b'{"serial": ""}', b'{"battery": null}', b'{"port": "COM6"}', b"not json",
        b"[" * 100_000, b'{"can": "\\ud800"}', b"\xff\xfe{}",
    ],
)  # fmt: skip
def test_a_file_that_is_no_choice_is_set_aside_and_one_can_be_made_again(tmp_path, setup, content):
    (tmp_path / FILE).write_bytes(content)
    assert setup.chosen is None
    assert setup.is_needed
    (kept,) = tmp_path.iterdir()
    assert kept.name.startswith(f"{FILE}.damaged-2")
    assert kept.read_bytes() == content
    setup.choose(ORION)
    assert setup.chosen == ORION


def test_a_choice_is_kept_and_starts_the_service_again(tmp_path, setup):
    started = []
    setup.on_choice = lambda: started.append(load_connections(tmp_path))
    assert setup.is_needed
    assert load_connections(tmp_path) is None
    setup.choose(ORION)
    assert started == [ORION]
    assert not setup.is_needed


def test_a_choice_of_what_is_read_already_is_kept_and_starts_nothing_again(tmp_path):
    name = Setup(tmp_path, Connections(), fixed=False).upload(FILES)
    setup = Setup(tmp_path, Connections(can="socketcan:can0", battery=name), fixed=False)
    started = []
    setup.on_choice = lambda: started.append(setup.chosen)
    assert not setup.choose(setup.in_force)
    assert setup.chosen == setup.in_force
    setup.upload({**FILES, "two.toml": PROFILE.replace(b"two cells", b"other cells")})
    assert setup.choose(setup.in_force), "the same name, another profile"
    assert started == [setup.in_force]


def test_the_command_line_wins(tmp_path):
    setup = Setup(tmp_path, Connections(), fixed=True)
    assert not setup.is_needed
    with pytest.raises(NotNow):
        setup.choose(ORION)


@pytest.mark.parametrize(
    ("choice", "field"),
    [
        (Connections(serial="foo://bar"), "serial"),
        (Connections(can="can0"), "can"),
        (Connections(battery="no such one"), "battery"),
        (Connections(serial="COM6", battery="orion-bms-2"), "serial"),
    ],
)
def test_what_cannot_work_is_refused_by_its_field_and_not_kept(setup, tmp_path, choice, field):
    with pytest.raises(ConfigError, match=field):
        setup.choose(choice)
    assert load_connections(tmp_path) is None


def test_an_uploaded_profile_can_be_chosen(setup, tmp_path):
    name = setup.upload(FILES)
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
def test_an_upload_that_is_no_battery_is_refused_and_not_kept(setup, tmp_path, files):
    with pytest.raises(ConfigError):
        setup.upload(files)
    assert not list(tmp_path.rglob("*.toml"))


@pytest.mark.parametrize("others", ["socketcan:can1", "slcan:/dev/ttyACM0?bitrate=250000,pcan:PCAN_USBBUS1"])
def test_a_battery_has_one_bus(others):
    with pytest.raises(ConfigError, match="one bus"):
        Connections(can=f"socketcan:can0,{others}", battery="orion-bms-2").check(by_operator=True)


@pytest.mark.parametrize("first", ["socketcan:can0", "vector:0,1", "slcan:socket://a:1?timeout=0.05"])
def test_a_channel_may_hold_a_comma_and_of_several_buses_kept_before_the_batterys_own_is_read(tmp_path, first):
    own = Connections(can=first, battery="orion-bms-2")
    own.check(by_operator=True)
    save_connections(tmp_path, Connections(can=f"{first},socketcan:can1", battery="orion-bms-2"))
    assert load_connections(tmp_path) == own


def test_a_kept_choice_may_leave_links_out(tmp_path):
    (tmp_path / FILE).write_text('{"serial": null, "can": null}')
    assert load_connections(tmp_path) == Connections()


@pytest.mark.parametrize("name", ["", ".hidden", "..", "a/b.dbc", "two\0.dbc", "two\n.dbc", "x" * 201, "ø" * 101])
def test_a_name_that_no_file_has_is_refused_before_anything_is_written(setup, tmp_path, name):
    with pytest.raises(ConfigError, match=r"(?s)files = .*a plain file name"):
        setup.upload({name: DBC, "two.toml": PROFILE})
    assert list(tmp_path.iterdir()) == []


def test_two_profiles_in_one_upload_are_refused_by_their_names(setup):
    with pytest.raises(ConfigError, match=r"a\.toml, b\.toml"):
        setup.upload({"a.toml": PROFILE, "b.toml": PROFILE})


def test_an_upload_that_is_wrong_leaves_the_one_before_it(setup, tmp_path):
    name = setup.upload(FILES)
    with pytest.raises(ConfigError):
        setup.upload({"two.dbc": DBC, "two.toml": PROFILE.replace(b"[2]", b"[0]")})
    assert setup.batteries()[name].battery.n_cells == 2
    assert [path.name for path in (tmp_path / "batteries").iterdir()] == ["two"], "nothing half-made is left"


def test_an_upload_takes_the_place_of_one_of_the_same_name_with_all_its_files(setup):
    setup.upload({**FILES, "old.dbc": DBC})
    name = setup.upload(FILES)
    assert sorted(path.name for path in Path(name).parent.iterdir()) == ["two.dbc", "two.toml"]


def test_a_battery_that_is_wrong_is_left_out_of_the_list_and_the_others_stay(setup, tmp_path):
    good = setup.upload(FILES)
    broken = tmp_path / "batteries" / "broken" / "broken.toml"
    broken.parent.mkdir()
    broken.write_text("[battery")
    found = setup.batteries()
    assert good in found
    assert str(broken) not in found
    assert "orion-bms-2" in found


class _Lesson:
    """Counts how often the bus was given free."""

    def __init__(self):
        self.closed = 0

    def close(self):
        self.closed += 1


def test_one_lesson_at_a_time_has_the_bus_and_a_choice_ends_it(setup):
    first, second = _Lesson(), _Lesson()
    ids = [setup.begin_draft(first), setup.begin_draft(second)]
    assert ids[0] != ids[1]
    assert (first.closed, second.closed) == (1, 0)
    assert setup.draft == (ids[1], second)
    setup.choose(ORION)
    assert (second.closed, setup.draft) == (1, None)
    setup.end_draft()
    assert second.closed == 1


def test_a_choice_that_is_refused_leaves_the_lesson(setup):
    draft = _Lesson()
    setup.begin_draft(draft)
    with pytest.raises(ConfigError):
        setup.choose(Connections(can="can0"))
    assert draft.closed == 0


@pytest.mark.usefixtures("written")
@pytest.mark.parametrize("battery", ["two.toml", "/dev/zero", "../{folder}/two.toml", "{folder}/two.toml"])
def test_a_choice_names_no_file_that_was_not_uploaded(setup, tmp_path, battery):
    chosen = Connections(battery=battery.format(folder=tmp_path))
    with pytest.raises(ConfigError, match=r"battery = .*upload"):
        setup.choose(chosen)
    save_connections(tmp_path, chosen)
    with pytest.raises(ConfigError, match=r"battery = .*upload"):
        load_connections(tmp_path)


def test_a_choice_names_uploaded_ones_shapes_and_the_one_in_force(tmp_path, written):
    in_force = str(written)
    setup = Setup(tmp_path / "data", Connections(battery=in_force), fixed=False)
    for battery in (in_force, "5x18", setup.upload(FILES)):
        setup.choose(Connections(battery=battery))


@pytest.mark.usefixtures("written")
@pytest.mark.parametrize(
    "hostile",
    [
        PROFILE.replace(b'"two.dbc"', b'"../../two.dbc"'),
        PROFILE.replace(b'"two.dbc"', b'["two.dbc", "/etc/passwd"]'),
        b'include = "/etc/passwd"\n' + PROFILE,
        PROFILE.replace(b"[battery]", b'[battery]\ncell = "../two.toml"'),
    ],
)
def test_an_uploaded_profile_names_no_file_outside_of_its_folder(setup, hostile):
    with pytest.raises(ConfigError, match="own folder"):
        setup.upload({"two.dbc": DBC, "two.toml": hostile})
