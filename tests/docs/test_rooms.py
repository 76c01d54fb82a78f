"""The rooms of `app/`: docs/explanation/how-it-works.md draws them as the imports are, and no circle is among them.

A room is a folder or a file directly in a package.
"""

import ast
import graphlib
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/explanation/how-it-works.md"
PACKAGES = ("app", "simulator", "firmware_protocol")
C_FOLDER = ROOT / "firmware_protocol" / "c"

Graph = Mapping[str, set[str]]


def module_name(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def statements(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield every statement at whatever depth; `ast.walk` looks at every name and number too, ten times as many."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            waiting += getattr(node, part, ())


@cache
def named_in(file: Path) -> list[str]:
    """Return what a file imports, by its full name (for its types only counts too)."""
    named: list[str] = []
    for node in statements(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            named += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            named += [f"{node.module}.{alias.name}" for alias in node.names]
    return named


def imports_of(folders: tuple[str, ...]) -> dict[str, set[str]]:
    """Return the modules of these folders, and which of them each one imports."""
    files = {module_name(file): file for folder in folders for file in (ROOT / folder).rglob("*.py")}
    graph: dict[str, set[str]] = {name: set() for name in files}
    for name, file in files.items():
        for named in named_in(file):
            target = named
            while target and target not in files:
                target = target.rpartition(".")[0]
            graph[name] |= {target} - {name, ""}
    return graph


@cache
def imports() -> dict[str, set[str]]:
    """Return who imports whom among our packages."""
    return imports_of(PACKAGES)


FOLDERS_OF_APP = sorted(
    {module_name(file) for file in (ROOT / "app").rglob("__init__.py") if file.parent.name != "static"}
)


def rooms_of(package: str) -> Graph:
    """Return the rooms of a package, and which of them each one imports."""
    inside = f"{package}."
    graph: dict[str, set[str]] = defaultdict(set)
    for module, targets in imports().items():
        if module.startswith(inside):
            room = module.removeprefix(inside).split(".")[0]
            graph[room] |= {
                target.removeprefix(inside).split(".")[0] for target in targets if target.startswith(inside)
            } - {room}
    return graph


def circle(graph: Graph) -> list[str]:
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def drawn() -> dict[str, set[str]]:
    """Return the drawing of the page: the table under `## Rooms`, from top to bottom."""
    section = PAGE.read_text(encoding="utf-8").partition("## Rooms\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| `(\w+)` \| [^|]+ \| ([^|]*) \|$", section, re.MULTILINE)
    return {room: set(re.findall(r"\w+", targets)) for room, targets in rows}


def test_the_drawing_is_what_the_imports_are() -> None:
    rooms, table = rooms_of("app"), drawn()
    assert set(table) == set(rooms)
    wrong = {
        room: ", ".join(name for name in table if name in targets)
        for room, targets in rooms.items()
        if table[room] != targets
    }
    assert wrong == {}, "the last column of these rows should read as above"


def test_no_arrow_of_the_drawing_points_upwards() -> None:
    order = list(drawn())
    assert [
        (room, target)
        for room, targets in drawn().items()
        for target in targets
        if order.index(target) < order.index(room)
    ] == []


@pytest.mark.parametrize("package", FOLDERS_OF_APP)
def test_rooms_of_a_folder_import_each_other_in_no_circle(package: str) -> None:
    assert circle(rooms_of(package)) == []


def test_no_files_import_each_other_in_a_circle() -> None:
    assert circle(imports_of((*PACKAGES, "benchmarks", "tests", ".ci"))) == []


def test_no_test_imports_a_benchmark() -> None:
    graph = imports_of(("tests", "benchmarks"))
    assert [name for name in graph if name.startswith("tests") for x in graph[name] if x.startswith("benchmarks")] == []


def test_files_of_the_c_library_include_each_other_in_no_circle() -> None:
    graph: dict[str, set[str]] = defaultdict(set)
    for file in C_FOLDER.glob("vw_*.[ch]"):
        graph[file.stem] |= set(re.findall(r'#include "(\w+)\.h"', file.read_text(encoding="utf-8"))) - {file.stem}
    assert len(graph) > 10
    assert circle(graph) == []
