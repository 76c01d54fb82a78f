"""TOML from elsewhere: what is beyond a limit is refused at once, and what is within it reads as the standard says."""

import time
import tomllib

import pytest

from app.estimation.toml_text import HIGHEST, LOWEST, MOST_CHARACTERS, MOST_LEVELS, MOST_OF_A_KEY, TomlError, read_toml

AT_ONCE_S = 2.0  # on a busy machine; the quadratic ones took a minute
BEYOND_LEVELS = {
    "lists": "a = " + "[" * 100_000,
    "tables": "a = " + "{a = " * 40_000,
    "a key of many parts": ".".join("a" * 100_000) + " = 1",
    "its parts apart by blanks": " . ".join("a" * 50_000) + " = 1",
    "quoted parts that hold other marks": ".".join(['",="'] * 50_000) + " = 1",
    "parts in single quotes": ".".join(["'#'"] * 50_000) + " = 1",
    "a table's name": "[" + ".".join("a" * 100_000) + "]",
    "keys and brackets in turn": "a.b.c = {a.b.c = [{a.b.c = 1}]}",
}
BEYOND_NUMBERS = {
    "digits": "a = " + "9" * 60_000,
    "hexadecimal": "b = [1, {a = 0x" + "f" * 60_000 + "}]",
    "one too many": f"a = {HIGHEST + 1}",
    "one too few": f"a = {LOWEST - 1}",
}
NOT_TOML = [
    "a = 2026-13-45",
    "a = 2026-01-01T00:00:00+99:99",
    'a = "' + '\\"' * 50_000,
    '"' * 100_000,
    "'''" + "\n" * 9,
    "]",
]


@pytest.mark.parametrize("text", BEYOND_LEVELS.values(), ids=BEYOND_LEVELS)
def test_what_is_too_deep_is_refused_by_its_line_before_it_is_parsed(text):
    began = time.monotonic()
    with pytest.raises(TomlError, match=f"more than {MOST_LEVELS} levels .* line 2") as refused:
        read_toml(f"# a comment with [[[[[[[[[[[[[[[[[\n{text}")
    assert refused.value.line == 2
    assert time.monotonic() - began < AT_ONCE_S


@pytest.mark.parametrize("text", BEYOND_NUMBERS.values(), ids=BEYOND_NUMBERS)
def test_a_whole_number_beyond_64_bits_is_refused_with_the_limit(text):
    with pytest.raises(TomlError, match=str(HIGHEST)):
        read_toml(text)


def test_a_long_text_and_a_long_key_are_refused_with_the_limit():
    with pytest.raises(TomlError, match=str(MOST_CHARACTERS)):
        read_toml("#" * (MOST_CHARACTERS + 1))
    with pytest.raises(TomlError, match=f"at most {MOST_OF_A_KEY}"):
        read_toml("[" + "k" * 60_000 + "]\na = 1")


@pytest.mark.parametrize("text", NOT_TOML, ids=range(len(NOT_TOML)))
def test_what_is_no_toml_is_one_kind_of_error(text):
    with pytest.raises(TomlError):
        read_toml(text)


@pytest.mark.parametrize(
    "text",
    [
        "'''[[[[[[[[[['''= 1\n".replace("'''", "'"),
        'a = """\n[[[[[[[[[[ \\""" {{{{{{{{{{\n"""\nb = 1',
        "a = '''\n[[[[[[[[[[ ''\n'''\nb = ''''x'''''",
        'a = "\\"[[[[[[[[[[" # {{{{{{{{{{\nb = 1.5',
        "a = [" + ",\n".join(["[1.5, 2.5]"] * 1000) + "]",
        "[[source.voltage]]\nnumbers = {cell.a = [{b = 1}]}\n" * 100,
        f"a = [{HIGHEST}, {LOWEST}, 1e999, -inf, nan, 2026-07-14T10:30:00Z]",
    ],
)
def test_what_stands_in_strings_and_comments_is_no_level(text):
    assert str(read_toml(text)) == str(tomllib.loads(text))  # as text: NaN is not equal to itself
