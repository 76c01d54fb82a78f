"""The documentation as a site: every link and anchor leads somewhere, the search finds, the Python API is there."""

import functools
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from playwright.sync_api import expect, sync_playwright

from tests.e2e.conftest import CHROMIUM, FLAGS

pytest.importorskip("mkdocs", reason="mkdocs is not installed: make site")
pytestmark = pytest.mark.timeout(600)  # it builds
ROOT = Path(__file__).resolve().parents[2]
FINDS = {
    "black box": "After a run",
    "motec": "MoTeC",
    "phone": "Phones in the pit",
    "dbc": "Your BMS in ten minutes",
    "weakest": "Find the weakest cell",
    "export": "Export",
}  # what users type: a page or section that the search then lists


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(site))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_every_document_is_a_page_and_its_pictures_are_there(site: Path) -> None:
    documents = [file.relative_to(ROOT / "docs") for file in (ROOT / "docs").rglob("*.md")]
    of_document = {"index.html": "index.html"}
    for document in documents:
        page = "index.html" if document.name == "index.md" else f"{document.with_suffix('')}/index.html"
        of_document[str(document)] = page
    assert [page for page in of_document.values() if not (site / page).is_file()] == []
    pictures = {file.name for file in (ROOT / "docs" / "images").iterdir()}
    assert {file.name for file in (site / "images").iterdir()} == pictures


def test_the_search_finds_and_the_python_api_stands_with_its_docstrings(address: str) -> None:
    path = next((found for name in CHROMIUM if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("chromium is not installed")
    with sync_playwright() as playwright, playwright.chromium.launch(executable_path=path, args=FLAGS) as browser:
        page = browser.new_page()
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(address)
        page.get_by_label("Search").first.click()
        field = page.locator(".md-search__input")
        for words, title in FINDS.items():
            field.clear()
            field.press_sequentially(words)
            expect(page.locator(".md-search-result__link", has_text=title).first).to_be_visible()
        page.goto(f"{address}/reference/python-api/")
        expect(page.locator("#voltwall\\.open")).to_be_visible()
        expect(page.get_by_text("Units are SI with degrees Celsius")).to_be_visible()
        assert [url for url in asked if not url.startswith(address)] == []  # it loads nothing from elsewhere


def test_the_crew_card_prints_on_one_page_of_a5(address: str) -> None:
    path = next((found for name in CHROMIUM if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("chromium is not installed")
    with sync_playwright() as playwright, playwright.chromium.launch(executable_path=path, args=FLAGS) as browser:
        page = browser.new_page()
        page.goto(f"{address}/howto/crew-card/")
        printed = page.pdf(prefer_css_page_size=True)
    [(width, height)] = re.findall(rb"/MediaBox ?\[0 0 ([\d.]+) ([\d.]+)\]", printed)
    assert (round(float(width)), round(float(height))) == (420, 595)  # points
