import shutil

from app.season.lake.background import main


def test_it_builds_at_the_priority_that_it_is_told_and_says_what_is_left_out_alone(
    season, tmp_path, capsys, monkeypatch
):
    shutil.copytree(season, tmp_path / "sessions", ignore=shutil.ignore_patterns("lake*"))
    (tmp_path / "sessions" / "broken.sqlite").write_bytes(b"no session")
    given = []
    monkeypatch.setattr("os.nice", given.append, raising=False)
    main(str(tmp_path), str(tmp_path / "lake"), "19")
    assert given == [19]
    assert len(list((tmp_path / "lake").rglob("sessions.parquet"))) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "broken is left out" in said.err
