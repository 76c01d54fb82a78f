import time

import pytest

from app.errors import ConfigError
from app.season.lake.build import build_lake, session_files
from app.season.lake.place import LakeFolder
from app.season.store import QueryFailed, QueryLimits, SeasonStore
from app.season.store.questions import ask, find_question, questions
from app.season.store.store import TABLE_NAMES, with_parameters


@pytest.fixture(scope="module")
def store(lake) -> SeasonStore:
    return SeasonStore(lake)


def rows(store: SeasonStore, sql: str, **parameters) -> list[list[object]]:
    return store.query(sql, parameters).rows()


def test_every_table_is_there(store):
    counts = [rows(store, f"SELECT count(*) FROM {table}")[0][0] for table in TABLE_NAMES]
    assert counts[:4] == [2, 6, 2 * 4 * 96, 4]
    assert counts[4] > 700


def test_every_table_of_an_empty_lake_is_empty(tmp_path):
    store = SeasonStore(tmp_path / "nothing")
    for table in TABLE_NAMES:
        assert rows(store, f"SELECT count(*) FROM {table}") == [[0]]
        assert rows(store, f"SELECT session FROM {table}") == []


def test_columns_have_their_types_and_null_is_null(store):
    answer = store.query("SELECT start_time, cell, counted_ah, findings FROM cells WHERE cell = 7 AND lap = 0")
    (first, *_) = answer.rows()
    assert first[0].startswith("2026-09-2")
    assert first[0].endswith("+00:00")
    assert first[1:] == [7, None, "joint"]


def test_a_signal_is_a_column_of_its_own_name(store):
    ((volts, soc),) = rows(store, 'SELECT min("v[40]"), min("estimate.soc[3]") FROM samples')
    assert volts == pytest.approx(3.4, abs=1e-3)
    assert 0.6 < soc < 0.9


def test_a_common_table_expression_joins_what_is_asked(store):
    sql = """
    -- a remark, and a keyword: WITH
    WITH worst AS (SELECT session, max(resistance_ohm) AS r FROM cells WHERE lap = 0 GROUP BY session)
    SELECT sessions.car, 1000 * worst.r FROM sessions JOIN worst ON worst.session = sessions.session ORDER BY 1;
    """
    found = rows(store, sql)
    assert [row[0] for row in found] == ["built-in-master-96-cells", "e-26-simulated"]
    assert [row[1] for row in found] == pytest.approx([3.0, 3.0], rel=0.02)


def test_values_and_columns_are_put_into_the_text(store):
    sql = 'SELECT max("$of"), count(*) FROM cells WHERE car = $car AND cell < $below'
    assert rows(store, sql, of="cell", car="e-26-simulated", below=3) == [[2, 12]]
    assert rows(store, sql, of="cell", car="o'no", below=3.0) == [[None, 0]]


def test_a_missing_value_is_named(store):
    with pytest.raises(ConfigError, match="below"):
        rows(store, "SELECT * FROM cells WHERE cell < $below")


def test_an_answer_is_cut_where_it_is_too_long(store):
    answer = store.query("SELECT cell FROM cells ORDER BY cell", limits=QueryLimits(rows=3))
    assert answer.rows() == [[0], [0], [0]]
    assert answer.is_cut
    assert not store.query("SELECT 1", limits=QueryLimits(rows=1)).is_cut


@pytest.mark.parametrize(
    "sql",
    [
        "DROP TABLE cells",
        "CREATE TABLE x (a INT)",
        "INSERT INTO cells SELECT * FROM cells",
        "SELECT 1; SELECT 2",
        "SET memory_limit = '1TB'",
        "ATTACH '/tmp/x.db'",
        "",
        "nonsense",
    ],
)
def test_what_is_no_single_select_is_refused(store, sql):
    with pytest.raises(QueryFailed):
        store.query(sql)


def test_an_error_of_the_engine_is_said(store):
    with pytest.raises(QueryFailed, match="voltages"):
        store.query("SELECT voltages FROM cells")


def test_a_value_that_python_does_not_know_is_said(lake):
    with pytest.raises(QueryFailed, match="range"):
        SeasonStore(lake).query("SELECT DATE '290000-01-01' AS day").rows()


def test_a_question_that_takes_too_long_is_stopped(store):
    sql = "SELECT sum(a.cell * b.cell * c.cell) FROM cells a, cells b, cells c"
    began = time.monotonic()
    with pytest.raises(QueryFailed):
        store.query(sql, limits=QueryLimits(seconds=0.2))
    assert time.monotonic() - began < 30.0


@pytest.mark.parametrize("question", [each.name for each in questions()])
def test_every_question_is_answered(store, question):
    answer = ask(store, question)
    assert answer.table.num_columns > 2


def test_the_lowest_voltage_is_of_the_low_cell(store):
    found = [row for row in ask(store, "lowest_voltage").rows() if row[2] == 2]
    assert min(found, key=lambda row: row[5])[3:5] == [4, 5]


@pytest.mark.parametrize("question", [each.name for each in questions() if each.name != "season_cells"])
def test_every_question_keeps_the_cars_apart_and_can_be_asked_of_one(store, question):
    every = ask(store, question)
    at = every.table.column_names.index("car")
    cars = {row[at] for row in every.rows()}
    for car in cars:
        assert ask(store, question, car=car).rows() == [row for row in every.rows() if row[at] == car]
    assert ask(store, question, car="none").rows() == []


def test_the_ranking_begins_with_the_cell_that_resists_most(store):
    answer = ask(store, "ranking")
    first = dict(zip(answer.table.column_names, answer.rows()[0], strict=True))
    assert (first["pack"], first["cell_in_pack"]) == (1, 8)
    assert first["above_median_percent"] == pytest.approx(50.0, abs=2.0)


def test_hot_laps_take_the_degrees_that_were_asked_for(store):
    assert len(ask(store, "hot_laps", degc="21.5").rows()) == 2 * 2
    assert ask(store, "hot_laps").rows() == []


def test_an_unknown_question_or_parameter_is_named(store):
    with pytest.raises(ConfigError, match="ranking"):
        ask(store, "weather")
    with pytest.raises(ConfigError, match="degc"):
        ask(store, "hot_laps", kelvin="300")
    with pytest.raises(ConfigError, match="a number"):
        ask(store, "hot_laps", degc="warm")


def test_what_is_built_meanwhile_is_in_the_next_answer(season, tmp_path):
    store = SeasonStore(tmp_path / "lake")
    assert rows(store, "SELECT count(*) FROM sessions") == [[0]]
    build_lake(LakeFolder(tmp_path / "lake"), session_files([season])[:1])
    assert rows(store, "SELECT count(*) FROM sessions") == [[1]]


@pytest.mark.parametrize(
    "sql",
    [
        "SELECT * FROM read_text('/etc/hostname')",
        "SELECT * FROM read_parquet('{outside}')",
        "SELECT * FROM '{outside}'",
        "SELECT * FROM read_text('{root}/../secret.txt')",
        "SELECT * FROM read_csv('http://127.0.0.1:1/x.csv')",
        "COPY (SELECT 1) TO '{root}/x.csv'",
        "EXPLAIN ANALYZE COPY (SELECT 1) TO '{root}/x.csv'",
        "INSTALL httpfs",
    ],
)
def test_duckdb_reaches_nothing_but_the_lake(lake, tmp_path, sql):
    (lake.parent / "secret.txt").write_text("secret")
    outside = tmp_path / "other.parquet"
    outside.write_bytes(next(lake.rglob("cells.parquet")).read_bytes())
    before = sorted(lake.rglob("*"))
    with pytest.raises(QueryFailed):
        SeasonStore(lake).query(sql.format(root=lake, outside=outside))
    assert sorted(lake.rglob("*")) == before


def test_duckdb_reads_a_lake_by_url(season):
    place = LakeFolder("memory://store/lake")
    build_lake(place, session_files([season]))
    store = SeasonStore("memory://store/lake")
    assert rows(store, "SELECT count(*) FROM cells") == [[768]]
    with pytest.raises(QueryFailed):
        store.query("SELECT * FROM read_text('/etc/hostname')")


def test_memory_is_limited(lake):
    with pytest.raises(QueryFailed, match="memory"):
        SeasonStore(lake).query(
            "SELECT list(a.cell), list(b.cell) FROM cells a, cells b", limits=QueryLimits(memory_mb=16)
        )


def test_sessions_of_different_batteries_stand_in_one_table(lake, season, tmp_path):
    """Columns that one has not are null."""
    import pyarrow.parquet as pq

    folder = tmp_path / "lake"
    build_lake(LakeFolder(folder), session_files([season]))
    path = next(folder.rglob("car=built-in*/**/samples.parquet"))
    table = pq.read_table(path, partitioning=None)
    pq.write_table(table.rename_columns([name.replace("v[95]", "other") for name in table.column_names]), path)
    mark = path.with_name("sessions.parquet")
    row = pq.read_table(mark, partitioning=None)
    at = row.schema.get_field_index("layout")
    pq.write_table(row.set_column(at, row.schema.field(at), [["another"]]), mark)
    store = SeasonStore(folder)
    found = rows(store, 'SELECT count("v[95]"), count("other"), count("v[0]") FROM samples')
    assert found[0][0] + found[0][1] == found[0][2]
    assert min(found[0]) > 0


def test_parameters_are_quoted():
    assert with_parameters('"$a" = $b', {"a": 'x"y', "b": "it's"}) == "\"x\"\"y\" = 'it''s'"
    with pytest.raises(ConfigError, match="backslash"):
        with_parameters("$a", {"a": "\\'"})
    with pytest.raises(ConfigError, match="a number"):
        with_parameters("$a", {"a": float("nan")})


def test_a_question_says_what_it_answers_and_what_it_takes():
    for each in questions():
        assert each.meaning.endswith("."), each.name
        assert set(each.values({})) == {parameter.name for parameter in each.parameters}
    assert find_question("nothing") is None
