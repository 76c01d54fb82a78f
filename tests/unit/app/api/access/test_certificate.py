import stat

import pytest
from cryptography import x509

from app.api.access.certificate import CERTIFICATE, KEY, given_certificate, own_certificate
from app.errors import ConfigError

NOW_S = 1_795_000_000.0  # November 2026
DAY_S = 86400.0


def read(folder) -> x509.Certificate:
    return x509.load_pem_x509_certificate((folder / CERTIFICATE).read_bytes())


def names(folder) -> set[str]:
    held = read(folder).extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return {str(each.value) for each in held}


def test_it_holds_every_address_and_the_host_and_only_its_owner_reads_the_key(tmp_path, monkeypatch):
    monkeypatch.setattr("socket.gethostname", lambda: "Pit-Laptop")
    own_certificate(tmp_path, ["192.168.1.5", "2001:db8::5"], NOW_S)
    loopback = {"localhost", "127.0.0.1", "::1"}
    assert names(tmp_path) == {"192.168.1.5", "2001:db8::5", "pit-laptop", "pit-laptop.local"} | loopback
    assert stat.S_IMODE((tmp_path / KEY).stat().st_mode) == 0o600
    assert [path.name for path in tmp_path.iterdir() if path.name.endswith(".part")] == []


def test_it_stays_the_same_until_it_is_renewed_before_its_end(tmp_path):
    first = own_certificate(tmp_path, [], NOW_S)
    assert own_certificate(tmp_path, [], NOW_S + 300 * DAY_S) == first
    renewed = own_certificate(tmp_path, [], NOW_S + 310 * DAY_S)
    assert renewed.fingerprint != first.fingerprint
    assert renewed.ends_s > first.ends_s


def test_that_it_ends_soon_is_told(tmp_path):
    made = own_certificate(tmp_path, [], NOW_S)
    assert made.problem(made.ends_s - 15 * DAY_S) is None
    assert made.problem(made.ends_s - 13.5 * DAY_S).args["days"] == 13
    assert made.problem(made.ends_s + DAY_S) is not None


def test_another_network_is_added_and_the_earlier_one_stays(tmp_path):
    own_certificate(tmp_path, ["10.0.0.7"], NOW_S)
    both = own_certificate(tmp_path, ["192.168.1.5"], NOW_S)
    assert {"10.0.0.7", "192.168.1.5"} <= names(tmp_path)
    assert own_certificate(tmp_path, ["10.0.0.7"], NOW_S) == both


def test_a_clock_in_1970_makes_none_that_ended_long_ago(tmp_path):
    assert own_certificate(tmp_path, [], 0.0).ends_s > NOW_S


def test_one_from_the_future_is_made_anew(tmp_path):
    first = own_certificate(tmp_path, [], NOW_S + 400 * DAY_S)
    assert own_certificate(tmp_path, [], NOW_S).ends_s < first.ends_s


@pytest.mark.parametrize("name", [CERTIFICATE, KEY])
def test_a_broken_file_is_replaced(tmp_path, name):
    first = own_certificate(tmp_path, [], NOW_S)
    (tmp_path / name).write_text("nothing")
    assert own_certificate(tmp_path, [], NOW_S).fingerprint != first.fingerprint


def test_a_file_of_the_users_that_is_none_is_named(tmp_path):
    own = own_certificate(tmp_path, [], NOW_S)
    assert given_certificate(own.certificate, own.key).fingerprint == own.fingerprint
    with pytest.raises(ConfigError, match=r"tls_cert.*PEM certificate"):
        given_certificate(own.key, own.key)
    with pytest.raises(ConfigError, match=r"tls_cert.*No such file"):
        given_certificate(tmp_path / "none.pem", own.key)
