"""Which passwords are refused; settings of versions before."""

from pathlib import Path

import pytest

from app.errors import ConfigError
from app.service.settings import LEAST_CHARACTERS, Settings, check_password


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


def test_a_withdrawn_setting_of_the_environment_does_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VOLTWALL_ALSO", "rear.toml@socketcan:can1")
    assert Settings(data=tmp_path).battery == "team"
