"""Writes the files that are derived from code, or with `--check` says which of them are not current.

Each generator is a function without arguments that returns the whole text of one file.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / ".ci")]

from reference import (  # noqa: E402
    battery_profile_reference,
    cli_reference,
    dependency_reference,
    season_lake_reference,
    settings_reference,
)
from sbom import sbom  # noqa: E402
from typescript import api_types, export_formats, fixture_schema, memory_map_types, page_texts  # noqa: E402

from app.estimation.cell_model.cell_file import load_cell  # noqa: E402
from app.estimation.filters.c_tables import c_tables  # noqa: E402
from firmware_protocol.c_header import header_text  # noqa: E402


def cell_of_team() -> str:
    """Return the C tables of the default cell."""
    return c_tables(load_cell("samsung-25r-10p"))


GENERATED: dict[str, Callable[[], str]] = {
    "docs/reference/battery-profile.md": battery_profile_reference,
    "docs/reference/cli.md": cli_reference,
    "docs/reference/season-lake.md": season_lake_reference,
    "docs/reference/settings.md": settings_reference,
    "docs/reference/dependencies.md": dependency_reference,
    "firmware_protocol/c/estimator/generated/vw_cell_of_team.h": cell_of_team,
    "firmware_protocol/c/generated/voltwall_protocol.h": header_text,
    "frontend/fixtures/schema.json": fixture_schema,
    "frontend/src/generated/api.ts": api_types,
    "frontend/src/generated/export_formats.ts": export_formats,
    "frontend/src/generated/memory_map.ts": memory_map_types,
    "frontend/src/generated/texts.ts": page_texts,
    "requirements/voltwall.cdx.json": sbom,
}


def stale_files() -> list[str]:
    """Return the generated files whose text on disk is not what the code gives now."""
    return [name for name, text in GENERATED.items() if not _is_current(ROOT / name, text())]


def write_all() -> None:
    """Write every generated file."""
    for name, text in GENERATED.items():
        (ROOT / name).parent.mkdir(parents=True, exist_ok=True)
        (ROOT / name).write_text(text(), encoding="utf-8")


def _is_current(file: Path, text: str) -> bool:
    return file.is_file() and file.read_text(encoding="utf-8") == text


def main(arguments: list[str]) -> int:
    """Check or write; 1 when something is not current."""
    if "--check" not in arguments:
        write_all()
        return 0
    stale = stale_files()
    for name in stale:
        print(f"{name} is not current: run make generated")
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
