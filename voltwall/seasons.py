"""A season: many sessions, asked in SQL."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from app.season.lake.build import build_lake, session_files
from app.season.lake.place import LakeFolder
from app.season.store import QueryLimits, SeasonStore
from app.season.store.questions import ask, questions
from app.words import render
from voltwall.tables import Closing, Table


def season(where: str | Path) -> Season:
    """Open a season lake.

    Args:
        where: the lake, a folder or a URL of fsspec; or the data folder of a service, whose lake it is then.

    Raises:
        VoltwallError: a package is missing, or the place is not understood.
    """
    text = str(where)
    if "://" not in text:
        folder = Path(text).expanduser()
        text = str(folder / "lake" if (folder / "sessions").is_dir() else folder)
    return Season(text)


class Season(Closing):
    """The lake of many sessions: the tables `sessions`, `laps`, `cells`, `events` and `samples`."""

    def __init__(self, lake: str) -> None:
        self.lake = lake
        self._store = SeasonStore(lake)

    def __repr__(self) -> str:
        return f"<voltwall.Season {self.lake}>"

    def close(self) -> None:
        """Nothing is open between two questions."""

    def sql(self, query: str, /, **parameters: str | int | float) -> Table:
        """Answer one SELECT.

        Args:
            query: where `$name` stands for a parameter, and `"$name"` for a column of that name.
            parameters: by name.

        Raises:
            VoltwallError: it is wrong, or no SELECT.
        """
        return Table(self._store.query(query, parameters, QueryLimits(seconds=3600.0, memory_mb=4096)).table)

    def ask(self, question: str, /, **parameters: object) -> Table:
        """Answer one of `questions` by its name; most take `car=`, else they tell of each car by itself.

        Raises:
            VoltwallError: there is none of this name, or a parameter is wrong.
        """
        given = {name: str(value) for name, value in parameters.items()}
        return Table(ask(self._store, question, QueryLimits(seconds=3600.0, memory_mb=4096), **given).table)

    @property
    def cars(self) -> list[str]:
        """The cars of the lake, by name; answers to `questions` keep them apart, and `car=` asks of one."""
        rows = self._store.query("SELECT DISTINCT car FROM sessions ORDER BY car").rows()
        return [str(row[0]) for row in rows]

    @property
    def questions(self) -> Mapping[str, str]:
        """Return the meanings of the bundled questions, by name."""
        return {question.name: question.meaning for question in questions()}

    def build(self, *places: str | Path) -> Mapping[str, str]:
        """Bring the lake up to date with folders of sessions, or session files.

        Returns:
            what became of each session: `made`, `current`, `not closed`, or why it was left out.

        Raises:
            OSError: the lake cannot be written.
        """
        paths = session_files([Path(place).expanduser() for place in places])
        built = build_lake(LakeFolder(self.lake), paths)
        failed = {session: render(why) for session, why in built.failed}
        states = {"made": built.made, "current": built.current, "not closed": built.not_closed}
        return {session: text for text, sessions in states.items() for session in sessions} | failed
