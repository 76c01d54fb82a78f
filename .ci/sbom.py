"""The software bill of materials (CycloneDX 1.6): what a wheel or an image brings next to our own code.

Python packages are those of `requirements/run.lock`, which the image installs; the browser's are those that
`frontend/src` imports and what these need, of `frontend/package-lock.json`. Made by `.ci/generated.py`; hatchling puts
it into every wheel as `voltwall-*.dist-info/sboms/voltwall.cdx.json` (PEP 770). Hashes stand in the locks.
"""

from __future__ import annotations

import importlib.metadata
import json
import re
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from reference import licence_of

from app import __version__

ROOT = Path(__file__).resolve().parent.parent
LOCKED = re.compile(r"^([A-Za-z0-9_.-]+)==([^\s;\\]+)", re.MULTILINE)
IMPORTED = re.compile(r"""(?:from\s*['"]|import\s*['"]|node_modules/)(@[\w.-]+/[\w.-]+|[a-z][\w.-]*)(?=[/'"])""")
Component = dict[str, Any]


def sbom() -> str:
    """Return the text of the bill of materials; the same locks give the same text."""
    components = sorted((*python_packages(), *browser_packages()), key=lambda component: str(component["bom-ref"]))
    ours = f"pkg:pypi/voltwall@{__version__}"
    name = json.dumps([ours, *(component["bom-ref"] for component in components)])
    document = {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, name)}",
        "version": 1,
        "metadata": {"component": _component("application", ours, "voltwall", __version__, {"id": "Apache-2.0"})},
        "components": components,
        "dependencies": [{"ref": ours, "dependsOn": [component["bom-ref"] for component in components]}],
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def python_packages() -> Iterator[Component]:
    """Yield the packages of the run lock with the licences that their own metadata states."""
    for name, version in LOCKED.findall((ROOT / "requirements" / "run.lock").read_text(encoding="utf-8")):
        yield _component("library", f"pkg:pypi/{name}@{version}", name, version, _licence(name))


def browser_packages() -> Iterator[Component]:
    """Yield the packages that the browser application is built from, without the tools that build and test it."""
    sources = (file for ending in ("ts", "svelte", "css") for file in (ROOT / "frontend" / "src").rglob(f"*.{ending}"))
    imported = {name for file in sources for name in IMPORTED.findall(file.read_text(encoding="utf-8"))}
    packages = json.loads((ROOT / "frontend" / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    waiting, seen = sorted(name for name in imported if f"node_modules/{name}" in packages), set[str]()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        facts = packages[f"node_modules/{name}"]
        waiting += facts.get("dependencies", {})
        reference = f"pkg:npm/{quote(name, safe='/')}@{facts['version']}"
        licence = {"name": facts["license"]} if "license" in facts else None
        yield _component("library", reference, name, facts["version"], licence)


def _licence(name: str) -> dict[str, str] | None:
    try:
        facts = importlib.metadata.metadata(name).json
    except importlib.metadata.PackageNotFoundError:
        return None  # a package of another system
    if "license_expression" in facts:
        return {"expression": str(facts["license_expression"])}
    return {"name": licence_of(name)}


def _component(kind: str, reference: str, name: str, version: str, licence: dict[str, str] | None) -> Component:
    component: Component = {"type": kind, "bom-ref": reference, "name": name, "version": version, "purl": reference}
    if licence is None:
        return component
    return component | {"licenses": [licence if "expression" in licence else {"license": licence}]}
