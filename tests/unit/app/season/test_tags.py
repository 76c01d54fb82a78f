"""Tags travel in the session's file, and sessions are found by them."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from app.errors import ConfigError
from app.season.tags import matches, tags_of, write_tags
from app.sessions.catalogue import Catalogue


@pytest.fixture
def session(make_session):
    path = make_session(np.arange(0.0, 1.0, 0.1), np.zeros(10), metadata={"driver": "Anna", "venue": "Rudskogen"})
    return Catalogue(path.parent), path


def test_tags_are_kept_in_the_file_and_listed_at_once(session):
    catalogue, path = session
    assert tags_of(catalogue.list()[0]) == {"driver": "Anna", "track": "Rudskogen"}
    kept = write_tags(path, {"driver": "Jonas", "tyres": " wet  new ", "text": ""}, t_wall_ns=1, who="x")
    assert kept == {"driver": "Jonas", "tyres": "wet new"}
    (info,) = catalogue.list()
    assert tags_of(info) == {"driver": "Jonas", "track": "Rudskogen", "tyres": "wet new"}
    write_tags(path, {}, t_wall_ns=2, who="x")
    assert tags_of(catalogue.list()[0])["driver"] == "Anna"


def test_sessions_are_found_by_words_tags_and_days(session):
    catalogue, path = session
    write_tags(path, {"tyres": "wet"}, t_wall_ns=1, who=None)
    (info,) = catalogue.list()
    start = datetime.fromtimestamp(info.started_wall_ns / 1e9, UTC)
    day, next_day = start.strftime("%Y%m%d"), (start + timedelta(days=1)).strftime("%Y-%m-%d")
    for words in ("", "wet anna", "tyres:wet", "driver:ann", "made", f"since:{day}", f"before:{next_day}"):
        assert matches(info, words), words
    fetched = replace(info, id=f"red-{info.id}", metadata=info.metadata | {"car": "red"})
    for words, is_found in (("car:red", True), ("car:blue", False), (f"before:{day}", False), (f"since:{day}", True)):
        assert matches(fetched, words) == is_found, words
    for words in ("tyres:slick", "dry", f"before:{day}", "since:2099-01-01", "wet dry"):
        assert not matches(info, words), words


def test_a_wrong_tag_is_refused_with_what_would_be_allowed(session):
    with pytest.raises(ConfigError, match="track"):
        write_tags(session[1], {"colour": "red"}, t_wall_ns=1, who=None)
    with pytest.raises(ConfigError, match="200"):
        write_tags(session[1], {"text": "x" * 201}, t_wall_ns=1, who=None)
