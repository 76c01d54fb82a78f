"""A command's output as a value."""

import pytest

from app import __version__
from app.sessions.worker.command import CommandRefused, output_of


def test_what_is_printed_comes_back(capsys):
    assert output_of(["--version"]) == f"voltwall {__version__}\n"
    assert capsys.readouterr() == ("", "")


def test_a_refusal_has_the_last_line_of_the_commands_words():
    with pytest.raises(CommandRefused, match=r"--rate: '9' is not 0.05 to 6 C"):
        output_of(["balance", "--rate=9"])
