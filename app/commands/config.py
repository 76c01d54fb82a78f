"""`voltwall config`: the master's configuration through a running service, for scripts."""

import argparse
import json
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

from app.commands.arguments import add_json_argument, add_trust_argument, described, write_out
from app.commands.config_service import JSON, OCTETS, REFUSED, ConfigService, Refusal
from app.commands.console import print_table
from app.configuration.saved_configuration import is_profile
from app.errors import ConfigError
from app.words import Message, render

DIFFERS = 1
_HISTORY = ("#", "time", "who", "what", "result", "change", "reason")
_URL = "http://127.0.0.1:8000"
_EPILOG = f"""\
SOURCE is {render(Message("source-names"))}.
Exit codes: 0 done; 1 differences (diff, compare); 2 rejected; 3 service or master not reachable, or login required;
4 configuration changed by another user; 5 sent but not verified: read again.
Set the password in VOLTWALL_PASSWORD, with the user in VOLTWALL_NAME, or an API token in VOLTWALL_PASSWORD."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Actions and where the service is."""
    parser.set_defaults(run=run)
    where = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    where.add_argument("--url", help=f"URL of the running service (default: {_URL})")
    parser.add_argument("--url", default=_URL, help="URL of the running service (default: %(default)s)")
    add_trust_argument(where)
    add_trust_argument(parser)
    parser.epilog = _EPILOG
    add = partial(parser.add_subparsers(dest="action", metavar="ACTION", required=True).add_parser, parents=[where])
    read = add("read", **described("print a configuration as JSON in units, or save it to a file"))
    read.add_argument(
        "source", nargs="?", default="in-force", metavar="SOURCE", help="configuration to read (default: %(default)s)"
    )
    read.add_argument("--out", type=Path, metavar="FILE", help="save as JSON (.json) or as image")
    diff = add("diff", **described("show what a write would change and check it; exit code 1 with differences"))
    write = add("write", **described("check, write and verify a configuration"))
    for action in (diff, write):
        action.add_argument(
            "edits",
            nargs="+",
            metavar="EDIT",
            help="FIELD=VALUE such as telemetry_period=50, a file (image, profile, JSON), or a SOURCE",
        )
        action.add_argument("--reason", default="", help="reason for a change with warnings")
    write.add_argument("--store", action="store_true", help="then store to EEPROM and verify")
    compare = add("compare", **described("compare two SOURCEs; exit code 1 with differences"))
    compare.add_argument("a", metavar="FROM", help="SOURCE, such as stored")
    compare.add_argument("b", metavar="TO", help="SOURCE, such as in-force")
    for action in (diff, compare):
        add_json_argument(action, default=False)
    add("store", **described("store the active configuration to EEPROM and verify"))
    add("load", **described("load the configuration from EEPROM"))
    rollback = add("rollback", **described("restore the configuration that was active before a write"))
    rollback.add_argument("record", nargs="?", type=int, help="record number in the history (default: the last write)")
    rollback.add_argument("--reason", default="", help="reason")
    history = add("history", **described("list every write with time, user, changes, reason and result"))
    history.add_argument("--json", action="store_true", help="print JSON")
    profiles = add("profiles", **described("list, save, get, put or delete named configurations"))
    profiles.add_argument(
        "what", nargs="?", choices=("list", "save", "get", "put", "delete"), default="list", help="default: list"
    )
    profiles.add_argument("name", nargs="?", help="profile name; get: NAME or NAME@VERSION; put: FILE")
    profiles.add_argument(
        "--from",
        dest="source",
        default="in-force",
        metavar="SOURCE",
        help="save: configuration to save (default: in-force)",
    )
    profiles.add_argument("--as", dest="new_name", metavar="NAME", help="put: another name than in the file")
    profiles.add_argument("--comment", help="save, put: comment")
    profiles.add_argument("--json", action="store_true", help="list: print JSON")
    profiles.add_argument("--out", type=Path, metavar="FILE", help="get: file to write (default: standard output)")


def run(args: argparse.Namespace) -> int:
    """Exit codes as --help says."""
    service = ConfigService(args.url, trust=args.trust)
    match args.action:
        case "read":
            return _read(service, args.source, args.out)
        case "diff":
            answer = _write(service, args.edits, args.reason, dry_run=True)
            print(json.dumps(answer, indent=2)) if args.json else _print_answer(answer)
            return DIFFERS if answer["difference"] else 0
        case "compare":
            answer = service.json("/compare", query={"a": args.a, "b": args.b})
            print(json.dumps(answer, indent=2)) if args.json else _print_changes(answer["difference"])
            return DIFFERS if answer["difference"] else 0
        case "write":
            _print_written(_write(service, args.edits, args.reason, dry_run=False))
            return _store(service) if args.store else 0
        case "load":
            print(f"in force: {service.send('/load', 'POST', {})['hash']}, as stored")
            return 0
        case "rollback":
            return _roll_back(service, args.record, args.reason)
        case "history":
            return _history(service, as_json=args.json)
        case "profiles":
            return _profiles(service, args)
    return _store(service)


def _read(service: ConfigService, source: str, out: Path | None) -> int:
    wants_json = out is None or out.suffix == ".json"
    if wants_json:
        answer = service.json("/source", query={"name": source})
        body, name = (json.dumps(answer["values"], indent=2) + "\n").encode(), answer["hash"]
    elif source == "in-force":
        body, name = service.ask(headers={"Accept": OCTETS})
    else:
        raise ConfigError("out", out, "an image is only read of what is in force; for other sources end it in .json")
    write_out(body, out)
    if out is not None:
        print(f"{out}: {name}")
    return 0


def _write(service: ConfigService, edits: list[str], reason: str, *, dry_run: bool) -> Any:
    _, etag = service.ask(headers={"Accept": OCTETS})
    kind, body = _body_of(edits)
    headers = {"If-Match": f'"{etag}"', "Content-Type": kind}
    query = {"reason": reason} | ({"dry_run": "true"} if dry_run else {})
    return service.json("", method="PUT", body=body, headers=headers, query=query)


def _body_of(edits: list[str]) -> tuple[str, bytes]:
    """Return the content type and the body that an edit's words mean."""
    values: dict[str, Any] = {}
    for edit in edits:
        name, equals, text = edit.partition("=")
        if equals:
            values[name] = _value(name, text)
            continue
        if _is_source(edit):
            _require_alone(edits, edit, "a source")
            return JSON, json.dumps({"source": edit}).encode()
        content = _load(edit)
        if Path(edit).suffix != ".json":
            _require_alone(edits, edit, "an image")
            return OCTETS, content
        document = _document(edit, content)
        if is_profile(document):
            _require_alone(edits, edit, "a profile")
            return JSON, content
        if not isinstance(document, dict):
            raise ConfigError("file", edit, "an object of fields and values, or a profile")
        values |= document
    return JSON, json.dumps({"values": values}).encode()


def _is_source(word: str) -> bool:
    kind = word.partition(":")[0]
    return kind in ("in-force", "stored", "default", "profile", "record", "session") and not Path(word).exists()


def _require_alone(edits: list[str], edit: str, what: str) -> None:
    if len(edits) > 1:
        raise ConfigError("edits", edit, f"{what} stands alone")


def _load(name: str) -> bytes:
    try:
        return Path(name).read_bytes()
    except OSError as error:
        raise ConfigError("file", name, error.strerror or str(error)) from error


def _document(name: str, content: bytes) -> Any:
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise ConfigError("file", name, f"not JSON: {error}") from error


def _value(name: str, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(name, text, "a number, or a JSON list") from error


def _store(service: ConfigService) -> int:
    answer = service.send("/store", "POST", {})
    print(f"stored: {answer['stored_hash']}, read back and equal (counter {answer['counter']})")
    return 0


def _roll_back(service: ConfigService, number: int | None, reason: str) -> int:
    if number is None:
        records = service.json("/history", query={"limit": "1000"})["records"]
        done = (r["number"] for r in records if r["action"] != "store" and r["from_hash"] and r["result"] == "done")
        number = next(done, None)
        if number is None:
            raise Refusal("nothing to roll back: the history holds no write that was done", REFUSED)
    _, etag = service.ask(headers={"Accept": OCTETS})
    _print_written(service.send(f"/history/{number}/rollback", "POST", {"reason": reason}, etag=etag))
    return 0


def _history(service: ConfigService, *, as_json: bool) -> int:
    records = service.json("/history", query={"limit": "1000"})["records"]
    if as_json:
        print(json.dumps(records, indent=2))
        return 0
    print_table(_HISTORY, [row for record in records for row in _of_record(record)], "><<<<<<")
    return 0


def _of_record(record: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """A row a change; what is the same for all of a record stands in the first."""
    when = datetime.fromtimestamp(record["time"], UTC).isoformat(timespec="seconds")
    result = record["result"] if record["genuine"] else f"SIGNATURE NOT RIGHT, {record['result']}"
    what = f"{record['action']} of {record['source']}"
    first, *others = _changes(record["difference"]) or [""]
    yield str(record["number"]), when, record["who"], what, result, first, record["reason"] or ""
    yield from ((*[""] * 5, change, "") for change in others)


def _profiles(service: ConfigService, args: argparse.Namespace) -> int:
    if args.what == "list":
        profiles = service.json("/profiles")["profiles"]
        if args.json:
            print(json.dumps(profiles, indent=2))
            return 0
        rows = [
            (f"{profile['name']}@{profile['version']}", profile["hash"], profile["comment"] or "")
            for profile in profiles
        ]
        print_table(("profile", "hash", "comment"), rows)
        return 0
    if args.name is None:
        raise ConfigError("name", "missing", f"profiles {args.what} NAME")
    match args.what:
        case "save":
            saved = service.send(_path(args.name), "PUT", {"source": args.source, "comment": args.comment or ""})
            print(f"{saved['name']}@{saved['version']}  {saved['hash']}")
        case "put":
            document = _document(args.name, _load(args.name))
            name = args.new_name or (document.get("name") if is_profile(document) else None) or Path(args.name).stem
            body = {"profile": document, "comment": args.comment}
            saved = service.send(_path(str(name)), "PUT", body)
            print(f"{saved['name']}@{saved['version']}  {saved['hash']}")
        case "get":
            name, _, version = args.name.partition("@")
            text, _ = service.ask(_path(name), query={"version": version} if version else None)
            write_out(text, args.out)
        case "delete":
            service.ask(_path(args.name), method="DELETE")
    return 0


def _path(name: str) -> str:
    return f"/profiles/{quote(name, safe='')}"


def _print_written(answer: Any) -> None:
    _print_answer(answer)
    print(f"active: {answer['hash']}" + (", read back and equal" if answer["verified"] else ", unchanged"))


def _print_answer(answer: Any) -> None:
    _print_changes(answer["difference"])
    for warning in answer["warnings"]:
        if not warning["standing"]:
            print(f"{warning['level']}: {warning['message']['text']}", file=sys.stderr)
    if answer["block_reason"]:
        print(f"not now: {answer['block_reason']['text']}", file=sys.stderr)


def _print_changes(changes: list[dict[str, Any]]) -> None:
    for change in _changes(changes):
        print(change)


def _changes(changes: list[dict[str, Any]]) -> list[str]:
    lines = []
    for change in changes:
        element = "" if change["element"] is None else f"[{change['element']}]"
        lines.append(f"{change['field']}{element}: {change['from']} -> {change['to']} {change['unit']}".rstrip())
    return lines
