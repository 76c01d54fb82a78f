"""What is shipped is listed, and an audit that could not ask says so."""

import importlib.util
import json
import re
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
SBOM = json.loads((ROOT / "requirements" / "voltwall.cdx.json").read_text(encoding="utf-8"))
LISTED = {component["bom-ref"]: component for component in SBOM["components"]}


@pytest.fixture(scope="module")
def audit() -> ModuleType:
    spec = importlib.util.spec_from_file_location("audit", ROOT / ".ci" / "audit.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_package_of_the_image_is_listed_in_its_version() -> None:
    lock = (ROOT / "requirements" / "run.lock").read_text(encoding="utf-8")
    locked = {f"pkg:pypi/{name}@{version}" for name, version in re.findall(r"(?m)^([\w.-]+)==([^\s;]+)", lock)}
    assert {reference for reference in LISTED if reference.startswith("pkg:pypi/")} == locked
    assert len(locked) > 30


def test_every_package_of_the_page_is_listed_in_its_version() -> None:
    packages = json.loads((ROOT / "frontend" / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    listed = {one["name"]: one["version"] for name, one in LISTED.items() if name.startswith("pkg:npm/")}
    assert {"svelte", "uplot", "uqr", "@fontsource-variable/ibm-plex-sans"} <= set(listed)
    assert all(packages[f"node_modules/{name}"]["version"] == version for name, version in listed.items())
    assert not {"vite", "typescript", "eslint", "vitest"} & set(listed), "tools are not shipped"


def test_each_is_there_once_with_a_licence() -> None:
    assert len(LISTED) == len(SBOM["components"])
    assert SBOM["dependencies"][0]["dependsOn"] == [*LISTED]
    assert [name for name, one in LISTED.items() if "licenses" not in one] == []


def test_it_goes_into_every_wheel() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["tool"]["hatch"]["build"]["targets"]["wheel"]["sbom-files"] == ["requirements/voltwall.cdx.json"]


SOUND = {"name": "a", "version": "1", "vulns": []}
SKIPPED = {"name": "bad-luck", "skip_reason": "not found"}
OPEN = {"name": "c", "version": "2", "vulns": [{"id": "PYSEC-1", "fix_versions": ["3"]}]}


@pytest.mark.parametrize(
    ("packages", "code"), [([SOUND], 0), ([SOUND, SKIPPED], 2), ([SKIPPED, OPEN], 1), ([OPEN], 1), ([], 2)]
)
def test_a_python_package_that_was_not_asked_about_is_no_good_answer(audit, packages, code) -> None:
    found, lines = audit.judge_python({"dependencies": packages})
    assert found == code
    assert [name in " ".join(lines) for name in ("bad-luck", "c 2: PYSEC-1, mended in 3")] == [
        SKIPPED in packages,
        OPEN in packages,
    ]


@pytest.mark.parametrize(
    ("output", "code"),
    [
        ('{"vulnerabilities": {}}', 0),
        ('{"vulnerabilities": {"vite": {"severity": "high", "range": "<9"}}}', 1),
        ('npm warn\n{"error": {"summary": "405"}}', 2),
        ("npm error audit endpoint returned an error", 2),
        ("", 2),
    ],
)
def test_an_npm_that_could_not_ask_is_no_good_answer(audit, output, code) -> None:
    assert audit.judge_browser(1, output)[0] == code
