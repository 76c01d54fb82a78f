"""`voltwall season query`: SQL over a season, or one of the questions that come along."""

import argparse
import json
import sys
from dataclasses import asdict

from app.commands.console.terminal import print_table
from app.commands.season.build import lake_of
from app.errors import ConfigError
from app.season.lake.place import Place
from app.season.store import Answer, Limits, SeasonStore
from app.season.store.questions import ask, find_question, json_of, parameters_of, questions
from app.sessions.export.csv_file import csv_row


def answer_question(args: argparse.Namespace) -> int:
    """Print the answer.

    Raises:
        AppError: the question is wrong, not allowed, or takes too long.
    """
    if args.question is None:
        if getattr(args, "json", False):
            print(json.dumps([asdict(each) for each in questions()], indent=2))
        else:
            print_table((), [(each.name, each.meaning + parameters_of(each)) for each in questions()])
        return 0
    if args.show and (question := find_question(args.question)) is not None:
        print(question.sql, end="")
        return 0
    for option, least in (("limit_rows", 0), ("limit_s", 0.001), ("limit_mb", 16)):
        if not getattr(args, option) >= least:
            raise ConfigError(option.replace("_", "-"), getattr(args, option), f"at least {least}")
    limits = Limits(args.limit_s, args.limit_mb, args.limit_rows)
    lake = lake_of(args)
    if args.lake:
        Place(lake).check_there()
    answer = ask(SeasonStore(lake), args.question, limits, **dict(_pair(text) for text in args.set))
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
        print(json_of(answer))
    elif args.csv:
        sys.stdout.writelines(map(csv_row, [names, *rows]))
    else:
        print_table(names, [[_cell(value) for value in row] for row in rows])


def _cell(value: object) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
