"""`voltwall season query`: SQL over a season, or one of the questions that come along."""

import argparse
import csv
import json
import sys

from app.commands.season.lake import add_lake_argument, lake_of
from app.commands.session_commands.selection import add_json_argument, new_action
from app.errors import ConfigError
from app.season.store import Answer, Limits, open_store
from app.season.store.questions import Question, find_question, questions

ROWS = 1000


def add_actions(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    query = new_action(actions, "query", "answer SQL over the lake: one SELECT, or a question by its name", _query)
    lines = "\n".join(f"  {each.name:16} {each.meaning}{_parameters(each)}" for each in questions())
    query.epilog = (
        "Tables: sessions, laps, cells, events, samples; columns: docs/reference/season-lake.md.\n\nQuestions:\n"
        + lines
    )
    query.add_argument(
        "question",
        metavar="SQL|NAME",
        nargs="?",
        help='as "SELECT session, min(voltage_min_v) FROM cells GROUP BY 1"; without it the questions are listed',
    )
    query.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter of a question")
    query.add_argument("--show", action="store_true", help="print the SQL of a question instead of its answer")
    add_lake_argument(query)
    query.add_argument(
        "--store",
        metavar="ENGINE",
        default="duckdb",
        help="what answers: duckdb; clickhouse[s]://[USER[:PASSWORD]@]HOST[:PORT][/DATABASE],\n"
        "which sees the lake under the same path; chdb, ClickHouse in this process (default: %(default)s)",
    )
    query.add_argument("--limit-rows", type=int, default=ROWS, metavar="N", help="rows at most (default: %(default)s)")
    query.add_argument(
        "--limit-s", type=float, default=60.0, metavar="S", help="seconds at most (default: %(default)s)"
    )
    query.add_argument("--limit-mb", type=int, default=1024, metavar="MB", help="memory at most (default: %(default)s)")
    query.add_argument("--csv", action="store_true", help="as CSV")
    add_json_argument(query)


def _parameters(question: Question) -> str:
    return "".join(f"; --set {each.name}={each.default}" for each in question.parameters)


def _query(args: argparse.Namespace) -> int:
    """Print the answer.

    Raises:
        AppError: the question is wrong, not allowed, or takes too long.
    """
    if args.question is None:
        for each in questions():
            print(f"{each.name:16} {each.meaning}{_parameters(each)}")
        return 0
    question = find_question(args.question)
    if question is None and " " not in args.question.strip():
        raise ConfigError("question", args.question, "SQL, or one of " + ", ".join(each.name for each in questions()))
    if args.show and question is not None:
        print(question.sql, end="")
        return 0
    given = dict(_pair(text) for text in args.set)
    sql, values = (args.question, given) if question is None else (question.sql, question.values(given))
    for option, least in (("limit_rows", 0), ("limit_s", 0.001), ("limit_mb", 16)):
        if not getattr(args, option) >= least:
            raise ConfigError(option.replace("_", "-"), getattr(args, option), f"at least {least}")
    limits = Limits(args.limit_s, args.limit_mb, args.limit_rows)
    store = open_store(lake_of(args), args.store)
    try:
        answer = store.query(sql, values, limits)
    finally:
        store.close()
    _print(args, answer)
    if answer.is_cut and not getattr(args, "json", False):
        print(f"cut after {args.limit_rows} rows: --limit-rows", file=sys.stderr)
    return 0


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise ConfigError("set", text, "NAME=VALUE")
    return name, value


def _print(args: argparse.Namespace, answer: Answer) -> None:
    names, rows = answer.table.column_names, answer.rows()
    if getattr(args, "json", False):
        print(json.dumps({"columns": names, "rows": rows, "is_cut": answer.is_cut}, default=str))
    elif args.csv:
        csv.writer(sys.stdout, lineterminator="\n").writerows([names, *rows])
    else:
        shown = [names, *([_cell(value) for value in row] for row in rows)]
        widths = [max(len(row[k]) for row in shown) for k in range(len(names))]
        for row in shown:
            print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())


def _cell(value: object) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
