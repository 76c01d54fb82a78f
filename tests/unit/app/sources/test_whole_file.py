"""Replacing a file: the old one or the new one, and nothing beside it."""

import os
import sys
from pathlib import Path

import pytest

from app.sources.data_file import replace_file


def test_the_new_content_stands_where_the_old_one_did(tmp_path):
    path = tmp_path / "settings.json"
    for content in (b"old", b"new"):
        replace_file(path, content)
        assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_refused_file_leaves_the_old_one_and_nothing_beside_it(call, tmp_path, monkeypatch):
    path = tmp_path / "settings.json"
    replace_file(path, b"old")

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(*((os, call) if call == "fsync" else (Path, call)), refuse)
    with pytest.raises(OSError, match="No space"):
        replace_file(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such mode")
def test_a_private_file_is_its_owners(tmp_path):
    replace_file(tmp_path / "key", b"secret", is_private=True)
    assert (tmp_path / "key").stat().st_mode & 0o077 == 0


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such mode")
def test_a_private_file_takes_neither_a_draft_nor_an_old_file_that_all_may_read(tmp_path):
    for name in ("key", ".key.new"):  # an earlier version's, and what a crash left
        (tmp_path / name).write_bytes(b"readable by all")
        (tmp_path / name).chmod(0o644)
    replace_file(tmp_path / "key", b"secret", is_private=True)
    assert (tmp_path / "key").read_bytes() == b"secret"
    assert (tmp_path / "key").stat().st_mode & 0o077 == 0
    assert [each.name for each in tmp_path.iterdir()] == ["key"]
