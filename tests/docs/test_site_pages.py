"""The navigation of the documentation's site, and where its links lead; tests/packaging/test_site.py builds it."""

import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
REPOSITORY = f"{PROJECT['urls']['Source']}/blob/HEAD"


@pytest.fixture
def site_pages(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / ".ci"))
    import site_pages

    return site_pages


def test_every_document_is_in_the_navigation_once(site_pages) -> None:
    sections = site_pages.navigation((ROOT / "docs" / "index.md").read_text(encoding="utf-8"))
    titles = ["Tutorials", "How-to guides", "Reference", "Explanation", "Contributing"]
    assert [next(iter(section)) for section in sections] == titles
    pages = [page for section in sections for part in section.values() for entry in part for page in entry.values()]
    documents = {file.relative_to(ROOT / "docs").as_posix() for file in (ROOT / "docs").rglob("*.md")} - {"index.md"}
    assert sorted(pages) == sorted(documents | {"reference/protocol.md", site_pages.PYTHON})


@pytest.mark.parametrize(
    ("link", "page", "leads_to"),
    [
        ("howto/install.md", "index.md", None),
        ("../images/overview.png", "explanation/simulated-car.md", None),
        ("../firmware_protocol/SPEC.md", "index.md", "reference/protocol.md"),
        ("../../firmware_protocol/SPEC.md", "howto/firmware.md", "reference/protocol.md"),
        ("../../firmware_protocol/c", "howto/firmware.md", f"{REPOSITORY}/firmware_protocol/c"),
        ("../README.md", "index.md", f"{REPOSITORY}/README.md"),
        ("docs/howto/firmware.md", "project/changelog.md", "howto/firmware.md"),
        ("../tests/vectors/frames.json", "reference/protocol.md", f"{REPOSITORY}/tests/vectors/frames.json"),
    ],
)
def test_a_link_leads_to_a_page_of_the_site_or_to_the_repository(site_pages, link, page, leads_to) -> None:
    assert site_pages.target(link, page) == leads_to


def test_links_in_code_stay_as_they_are(site_pages) -> None:
    page = SimpleNamespace(file=SimpleNamespace(src_uri="index.md"))
    text = "[spec](../firmware_protocol/SPEC.md#crc) and `[spec](../firmware_protocol/SPEC.md)`\n"
    changed = site_pages.on_page_markdown(text, page, None, None)
    assert changed == "[spec](reference/protocol.md#crc) and `[spec](../firmware_protocol/SPEC.md)`\n"
