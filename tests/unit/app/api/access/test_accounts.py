import stat

import pytest

from app.api.access.accounts import DAY_S, FILE, Accounts
from app.errors import ConfigError

GOOD, BETTER = "correct horse", "battery staple"
NOW_S = 1_795_000_000.0


@pytest.fixture
def accounts(tmp_path):
    made = Accounts(tmp_path)
    made.put("Anna", "chief", GOOD)
    return made


def test_only_the_right_password_of_the_right_person(accounts):
    assert accounts.verify("anna ", GOOD).name == "Anna"
    for name, password in (("anna", BETTER), ("bob", GOOD), ("", ""), ("anna", "\ud800")):
        assert accounts.verify(name, password) is None


def test_the_file_holds_no_secret_and_only_its_owner_reads_it(accounts, tmp_path):
    _, secret = accounts.make_token("grafana", "viewer", 30, "Anna", NOW_S)
    text = (tmp_path / FILE).read_text()
    assert GOOD not in text
    assert secret not in text
    assert "$argon2id$" in text
    assert stat.S_IMODE((tmp_path / FILE).stat().st_mode) == 0o600


def test_a_command_beside_the_service_is_noticed(accounts, tmp_path):
    Accounts(tmp_path).put("bob", "viewer", BETTER)
    assert accounts.verify("bob", BETTER).role == "viewer"
    Accounts(tmp_path).remove("bob")
    assert accounts.find("bob") is None


def test_somebody_stays_chief(accounts):
    for refused in (
        lambda: accounts.put("Anna", "viewer", None),
        lambda: (accounts.put("b", "viewer", GOOD), accounts.remove("Anna")),
    ):
        with pytest.raises(ConfigError, match="at least one admin"):
            refused()
    accounts.put("ola", "chief", BETTER)
    assert accounts.remove("Anna")


def test_a_change_is_another_stamp_and_keeps_the_password_that_is_not_given(accounts):
    before = accounts.find("anna")
    accounts.put("Anna", "chief", None)
    assert accounts.find("anna").stamp != before.stamp
    assert accounts.verify("Anna", GOOD) is not None


@pytest.mark.parametrize(
    ("name", "password"),
    [("a:b", GOOD), ("", GOOD), ("x" * 41, GOOD), ("bob", "short"), ("bob", "Qwerty123456"), ("bob", None)],
)
def test_what_cannot_be_an_account_is_named(accounts, name, password):
    with pytest.raises(ConfigError):
        accounts.put(name, "viewer", password)
    assert len(accounts.all()) == 1


def test_a_token_ends_and_is_revoked(accounts):
    made, secret = accounts.make_token("grafana", "viewer", 30, "Anna", NOW_S)
    assert accounts.verify_token(secret, NOW_S + 29 * DAY_S) == made
    assert accounts.verify_token(secret, NOW_S + 30 * DAY_S) is None
    assert accounts.verify_token(made.digest, NOW_S) is None
    assert accounts.revoke_token(made.id)
    assert accounts.verify_token(secret, NOW_S) is None
    assert not accounts.revoke_token(made.id)


_ADA = '{"accounts": [{"name": "ada", "role": "chief", "password": "x", "stamp": "y"}], "tokens": []}'
BROKEN = {
    "empty": "",
    "cut": "{",
    "another object": "{}",
    "another list": "[]",
    "no account": '{"accounts": [{"name": 1}], "tokens": []}',
    "a name that is a number": _ADA.replace('"ada"', "1"),
    "a password that is a list": _ADA.replace('"x"', "[]"),
    "a role that is none": _ADA.replace("chief", "king"),
    "deep": "[" * 100_000,
    "a deep name": _ADA.replace('"ada"', "[" * 50_000 + "]" * 50_000),
}


@pytest.mark.parametrize("content", BROKEN.values(), ids=BROKEN)
def test_a_broken_file_lets_nobody_in(accounts, tmp_path, content):
    (tmp_path / FILE).write_text(content)
    with pytest.raises(ConfigError, match="not a user file"):
        Accounts(tmp_path)
    assert accounts.exist  # a running service opens to nobody
