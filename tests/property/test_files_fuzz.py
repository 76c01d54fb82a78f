"""Files of other people: any bytes are imported, or refused with the error that the caller expects."""

import contextlib
import json
from pathlib import Path

from hypothesis import example, given, settings
from hypothesis import strategies as st

from app.configuration.saved_configuration import SavedConfiguration, parse_profile, profile_text
from app.errors import ConfigError
from firmware_protocol.config_image import canonical, default_image
from firmware_protocol.dbc import to_dbc
from firmware_protocol.memory_map import CONFIG_SIZE
from tests.campaign import examples
from tests.fuzz.files import dbc, read_session

DEFAULT = default_image()
DBC = to_dbc(DEFAULT)
WORDS = st.sampled_from(
    ("BO_ ", "SG_ ", "BO_ 256 A: 8 master\n", ' SG_ soc : 0|16@1+ (0.0001,0) [0|1] "" V\n', "VAL_ ", "BA_ ", ":", "|")
)
NUMBERS = st.sampled_from(("0", "-1", "64", "4294967296", "9" * 40, "1e999", "nan", "٣"))


def mutated(text, changes):
    """Put pieces in, or cut pieces out, at places."""
    for at, length, piece in changes:
        at %= len(text) + 1
        text = text[:at] + piece + text[at + length :]
    return text


CHANGES = st.lists(
    st.tuples(st.integers(0, 1 << 16), st.integers(0, 40), WORDS | NUMBERS | st.text(max_size=12)), max_size=8
)


@given(st.builds(mutated, st.just(DBC), CHANGES) | st.text(max_size=300) | st.lists(WORDS | NUMBERS).map("".join))
@example(DBC)
@settings(max_examples=examples(250))
def test_any_dbc_is_read_or_refused(text):
    dbc(text.encode())


PROFILE = profile_text(SavedConfiguration("car 7", 3, "as raced", "ada", "2026-11-21T07:00:00Z", canonical(DEFAULT)))
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)


@given(st.builds(mutated, st.just(PROFILE), CHANGES) | JSON.map(json.dumps) | st.binary(max_size=200))
@example(PROFILE)
@example("[" * 100_000)
@settings(max_examples=examples(250))
def test_any_profile_is_read_or_refused_by_field(text):
    with contextlib.suppress(ConfigError):
        assert len(parse_profile(text).image) == CONFIG_SIZE


def places(document, path=()):
    """Every path to a value of a JSON document."""
    yield path
    inner = (
        document.items() if isinstance(document, dict) else enumerate(document) if isinstance(document, list) else ()
    )
    for key, value in inner:
        yield from places(value, (*path, key))


DOCUMENT = json.loads(PROFILE)


@given(st.sampled_from(list(places(DOCUMENT))[1:]), JSON)
@settings(max_examples=examples(300))
def test_any_value_at_any_place_of_a_profile_is_read_or_refused(path, value):
    document = json.loads(PROFILE)
    inner = document
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    with contextlib.suppress(ConfigError):
        assert len(parse_profile(json.dumps(document)).image) == CONFIG_SIZE


SESSION = max((Path(__file__).parents[1] / "unit/app/sessions/frozen").glob("session_*.sqlite")).read_bytes()
PAGES = len(SESSION) // 4096


def torn(hits, length):
    """The session with bytes changed, many in one page or few in several, and the rest of the file lost."""
    out = bytearray(SESSION)
    for page, at, data in hits:
        start = page * 4096 + at
        out[start : start + len(data)] = data
    return bytes(out[: len(SESSION) * length // 100])


HITS = st.lists(
    st.tuples(st.integers(0, PAGES - 1), st.integers(0, 4000), st.binary(min_size=1, max_size=90)), max_size=5
)


@given(st.tuples(HITS, st.sampled_from((100, 100, 100, 99, 50, 3))) | st.binary(max_size=300))
@settings(max_examples=examples(120))
def test_any_session_file_is_read_or_is_not_a_session(tmp_path_factory, damage):
    content = damage if isinstance(damage, bytes) else torn(*damage)
    path = tmp_path_factory.mktemp("torn") / "torn.sqlite"
    path.write_bytes(content)
    read_session(path)
