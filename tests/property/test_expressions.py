"""No text that comes from elsewhere stops the process in a regular expression: each is done in linear time.

Every expression of the product is found by import, those written in a call by its source. Each of its repeats is
pumped to 100,000 characters behind a text that leads there, with ends that match and ends that do not.
"""

import ast
import importlib
import inspect
import pkgutil
import re
import re._constants as code  # the parser of `re`: it alone knows what an expression repeats
import re._parser as parser
import signal
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import app
import firmware_protocol
import simulator
import voltwall
from tests.campaign import report_figure

CHARACTERS = 100_000
LIMIT_S = 0.1
PACKAGES = (app, firmware_protocol, simulator, voltwall)
METHODS = {"match", "fullmatch", "search", "sub", "subn", "split", "findall", "finditer"}
CANDIDATES = " 0aA\t_.-\"'[](){}:,;/#=@+|*MmeEx\\"
ENDS = ("", "\0")
REPEATS = (code.MAX_REPEAT, code.MIN_REPEAT, code.POSSESSIVE_REPEAT)
DYNAMIC = "x"  # in place of what an expression takes in when it runs


def modules() -> Iterator[ModuleType]:
    for package in PACKAGES:
        yield package
        for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            path = getattr(found.module_finder, "path", "")
            name = found.name.rpartition(".")[2]
            if name != "__main__" and ((Path(path) / f"{name}.py").exists() or found.ispkg):
                yield importlib.import_module(found.name)


def written(node: ast.expr) -> str:
    """The text of an expression in a call, with DYNAMIC for each part that is not written there."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else DYNAMIC
    if isinstance(node, ast.JoinedStr):
        return "".join(written(each) for each in node.values)
    if isinstance(node, ast.BinOp):
        return written(node.left) + written(node.right)
    return DYNAMIC


def expressions() -> dict[tuple[str, int], tuple[str, set[str]]]:
    """By expression and flags: where it is, and the methods that it is used with."""
    used: dict[str, set[str]] = defaultdict(set)
    found: dict[tuple[str, int], tuple[str, str]] = {}
    direct: dict[str, tuple[str, set[str]]] = {}
    for module in modules():
        for name, value in vars(module).items():
            if isinstance(value, re.Pattern) and isinstance(value.pattern, str):
                private = f"{module.__name__}.{name}" if name.startswith("_") else name
                found.setdefault((value.pattern, value.flags), (f"{module.__name__}.{name}", private))
        source = Path(inspect.getsourcefile(module) or "").read_text(encoding="utf-8")
        if not any(f".{method}(" in source for method in METHODS):
            continue
        tree = ast.parse(source)
        of_module: dict[str, set[str]] = defaultdict(set)
        names: dict[int, str] = {}
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                names[id(node.value)] = node.targets[0].id
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                owner = node.func.value
                if isinstance(owner, ast.Name) and node.func.attr in METHODS:
                    of_module[owner.id].add(node.func.attr)
        for name, methods in of_module.items():
            used[f"{module.__name__}.{name}" if name.startswith("_") else name] |= methods
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            owner, method = node.func.value, node.func.attr
            if isinstance(owner, ast.Name) and owner.id == "re" and method in {*METHODS, "compile"}:
                methods = {method} if method != "compile" else of_module[names.get(id(node), "")]
                where = f"{module.__name__}:{node.lineno}"
                direct.setdefault(written(node.args[0]), (where, set()))[1].update(methods)
    by_text = {key: (where, used[name] or {"match", "fullmatch"}) for key, (where, name) in found.items()}
    constants = {pattern for pattern, _ in by_text}
    return by_text | {(each, 0): what for each, what in direct.items() if each not in {*constants, DYNAMIC}}


def of_class(items: list[tuple[Any, Any]]) -> list[str]:
    """Characters of a class, of different kinds."""
    tree = parser.SubPattern(parser.State(), [(code.IN, items)])
    fits = re._compiler.compile(tree, 0)  # type: ignore[attr-defined]
    return [each for each in CANDIDATES if fits.match(each)][:6] or ["\u7535"]


def sample(tree: Any, *, is_long: bool) -> str:
    """A text that an expression takes, with or without what is optional."""
    text, groups = "", {}
    for kind, what in tree:
        if kind is code.LITERAL:
            text += chr(what)
        elif kind is code.NOT_LITERAL:
            text += "a" if what != ord("a") else "b"
        elif kind is code.ANY:
            text += "a"
        elif kind is code.IN:
            text += of_class(what)[0]
        elif kind is code.BRANCH:
            text += sample(what[1][0], is_long=is_long)
        elif kind is code.SUBPATTERN:
            groups[what[0]] = sample(what[3], is_long=is_long)
            text += groups[what[0]]
        elif kind is code.ATOMIC_GROUP:
            text += sample(what, is_long=is_long)
        elif kind is code.GROUPREF:
            text += groups.get(what, "")
        elif kind in REPEATS:
            low, high, body = what
            text += sample(body, is_long=is_long) * max(low, min(int(high), 1) if is_long else 0)
    return text


def pumps(body: Any) -> list[str]:
    """What a repeat can repeat: one text for each of its ways."""
    if len(body) == 1:
        ((kind, what),) = body
        if kind is code.IN:
            return of_class(what)
        if kind in (code.ANY, code.NOT_LITERAL):
            return [each for each in ' a0"-' if kind is code.ANY or each != chr(what)]
        if kind is code.BRANCH:
            return [pump for each in what[1] for pump in pumps(each)]
        if kind is code.SUBPATTERN:
            return pumps(what[3])
        if kind in (code.ATOMIC_GROUP,):
            return pumps(what)
    return [each for each in (sample(body, is_long=False), sample(body, is_long=True)) if each]


def attacks(tree: Any, before: str = "") -> Iterator[tuple[str, str]]:
    """For each repeat without a small bound: a text that leads to it, and what to repeat there."""
    for at, (kind, what) in enumerate(tree):
        for is_long in (False, True):
            lead = before + sample(tree[:at], is_long=is_long)
            inner: list[Any] = []
            if kind in REPEATS:
                inner = [what[2]]
                if int(what[1]) > 100:
                    yield from ((lead, pump) for pump in pumps(what[2]))
            elif kind is code.SUBPATTERN:
                inner = [what[3]]
            elif kind is code.ATOMIC_GROUP:
                inner = [what]
            elif kind is code.BRANCH:
                inner = what[1]
            elif kind in (code.ASSERT, code.ASSERT_NOT):
                inner = [what[1]]
            for each in inner:
                yield from attacks(each, lead)


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Ends a match that takes for ever: `re` lets signals through."""

    def end(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGVTALRM, end)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def use(pattern: re.Pattern[str], method: str, text: str) -> None:
    if method in ("sub", "subn"):
        getattr(pattern, method)("", text)
    elif method == "finditer":
        for _ in pattern.finditer(text):
            pass
    else:
        getattr(pattern, method)(text)


def worst(pattern: re.Pattern[str], methods: set[str]) -> tuple[float, str]:
    """The longest time of an attack [s of processor], and which; the first beyond the limit ends the search."""
    longest = 0.0, ""
    tree = parser.parse(pattern.pattern, pattern.flags)
    for lead, pump in sorted({*attacks(tree), *(("", pump) for _, pump in attacks(tree))}):
        pumped = lead + (pump * (CHARACTERS // len(pump) + 1))[:CHARACTERS]
        for end in ENDS:
            for method in sorted(methods):
                began = time.thread_time()
                try:
                    with at_most(1.0):
                        use(pattern, method, pumped + end)
                except TimeoutError:
                    pass
                took_s = time.thread_time() - began
                longest = max(longest, (took_s, f"{method}: {lead!r} + {pump!r} * n + {end!r}"))
                if took_s > LIMIT_S:
                    return longest
    return longest


def test_every_expression_takes_linear_time():
    found = {where: worst(re.compile(*key), methods) for key, (where, methods) in expressions().items()}
    assert len(found) > 60
    assert [f"{where}.{attack}" for where, (took_s, attack) in found.items() if took_s > LIMIT_S] == []
    longest_s = max(took_s for took_s, _ in found.values())
    report_figure(f"{len(found)} expressions, {CHARACTERS} characters: at most {1000 * longest_s:.0f} ms")


@pytest.mark.parametrize("pattern", [r"\s*SG_\s+(\w+)\s*M?\s*:", r"(a+)+b", r"\[\s*([\w ]+?)\s*\]$"])
def test_an_expression_that_backtracks_is_found(pattern: str):
    assert worst(re.compile(pattern), {"match"})[0] > LIMIT_S
