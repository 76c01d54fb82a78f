"""Settings of a battery beside the first; which passwords are refused."""

from pathlib import Path

import pytest

from app.errors import ConfigError
from app.service.settings import LEAST_CHARACTERS, Settings, check_password
from app.sources.connections import Connections

REAR = Connections(None, "socketcan:can1", "rear.toml")


def test_its_links_and_files_are_its_own_and_the_rest_is_the_firsts(tmp_path: Path) -> None:
    first = Settings(data=tmp_path, also="rear.toml", serial="COM6", cell="x", filter="ekf", scenario="y")
    rear = first.beside("rear", REAR)
    assert (rear.serial, rear.can, rear.battery, rear.also) == (None, "socketcan:can1", "rear.toml", None)
    assert (rear.cell, rear.scenario) == (None, None)
    assert rear.data == tmp_path / "beside" / "rear"
    assert rear.filter == "ekf"


def test_a_recorder_is_followed_once_however_many_batteries_are_read(tmp_path: Path) -> None:
    assert Settings(data=tmp_path, recorder="http://car").beside("rear", REAR).recorder is None


@pytest.mark.parametrize(("car", "expected"), [(None, "rear"), ("e42", "e42-rear"), ("e" * 36, "e" * 36 + "-rea")])
def test_to_a_broker_it_is_a_car_of_its_own(tmp_path: Path, car: str | None, expected: str) -> None:
    assert Settings(data=tmp_path, mqtt="mqtt://pit", car=car).beside("rear", REAR).car == expected


@pytest.mark.parametrize("password", ["Password1234", " qwerty123456 ", "121212121212", "x" * (LEAST_CHARACTERS - 1)])
def test_what_is_guessed_first_is_no_password(tmp_path: Path, password: str) -> None:
    with pytest.raises(ConfigError, match="password") as refused:
        check_password("password", password)
    assert password not in str(refused.value)
    shared = Settings(data=tmp_path, password=password)
    shared.check()  # one that was in use goes on
    assert shared.weak_passwords() == [str(refused.value)]


def test_a_sentence_is_a_password() -> None:
    check_password("password", "red flag on lap nine")


def test_a_shared_password_of_fewer_than_eight_characters_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="8 characters"):
        Settings(data=tmp_path, password="7 chars").check()
    assert Settings(data=tmp_path, password="red flag on lap nine").weak_passwords() == []
