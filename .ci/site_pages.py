"""Pages of the site (`make site`) next to the files of docs/: navigation, pages from elsewhere, the Python API.

The navigation is the list of docs/index.md. Of what lies outside docs/ the pages of OUTSIDE come with it; a link to
anything else leads to the repository.
"""

from __future__ import annotations

import posixpath
import re
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.structure.files import Files

ROOT = Path(__file__).resolve().parent.parent
REPOSITORY = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]["Source"]
OUTSIDE = {
    "firmware_protocol/SPEC.md": "reference/protocol.md",
    "CHANGELOG.md": "project/changelog.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "SECURITY.md": "project/security.md",
}  # a file of the repository: the page of it
PYTHON = "reference/python-api.md"
LINK = re.compile(r"(!?\[[^\]\n]*\]\()(?![a-z]+:|#)([^)#\s]+)(#[^)\s]*)?(\))")
FENCE = re.compile(r"(^```.*?^```|`[^`\n]*`)", re.MULTILINE | re.DOTALL)


def on_config(config: Any) -> Any:
    """Take the navigation from docs/index.md, and a link to the repository."""
    config.nav = [{"Documentation": "index.md"}, *navigation((ROOT / "docs" / "index.md").read_text(encoding="utf-8"))]
    project = [{Path(page).stem.title(): page} for page in OUTSIDE.values() if page.startswith("project/")]
    config.nav.append({"Project": [*project, {"Source": REPOSITORY}]})  # as repo_url every page would ask GitHub
    return config


def navigation(index: str) -> list[dict[str, Any]]:
    """Return the sections of docs/index.md with the pages that their lists name; the Python API after the protocol."""
    sections: list[dict[str, Any]] = []
    for part in index.split("\n## ")[1:]:
        title, _, text = part.partition("\n")
        pages = [
            {name[0].upper() + name[1:]: target(link, "index.md") or link}
            for line in text.splitlines()
            if line.startswith("- ")
            for name, link in re.findall(r"\[([^\]]+)\]\(([^)#]+\.md)\)", line)
        ]
        sections.append({title: pages})
        if title == "Reference":
            pages.insert(1, {"Python": PYTHON})
    return sections


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are no files of docs/."""
    from mkdocs.structure.files import File

    import voltwall

    for source, page in OUTSIDE.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text(encoding="utf-8")))
    parts = [f"::: voltwall.{name}" for name in voltwall.__all__ if name != "__version__"]
    options = "    options: {members: [], show_root_heading: false, show_root_toc_entry: false}"
    text = "\n\n".join(["# `import voltwall`", f"::: voltwall\n{options}", *parts])
    files.append(File.generated(config, PYTHON, content=text + "\n"))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Let the links of a page lead to pages of the site, or to the repository."""
    here = page.file.src_uri

    def changed(link: re.Match[str]) -> str:
        address = target(link[2], here)
        if address is None:
            return link[0]
        if not address.startswith(REPOSITORY):
            address = posixpath.relpath(address, posixpath.dirname(here) or ".")
        return f"{link[1]}{address}{link[3] or ''}{link[4]}"

    pieces = FENCE.split(markdown)  # code is every second one
    return "".join(piece if k % 2 else LINK.sub(changed, piece) for k, piece in enumerate(pieces))


def target(link: str, page: str) -> str | None:
    """Return what a link of a page of the site leads to, None where it is right as it is.

    Returns:
        A page of the site, from its root, or an address in the repository.
    """
    source = next((file for file, its in OUTSIDE.items() if its == page), f"docs/{page}")
    file = posixpath.normpath(posixpath.join(posixpath.dirname(source), link))
    if file in OUTSIDE:
        return OUTSIDE[file]
    if file.startswith("docs/"):
        return None if source.startswith("docs/") else file.removeprefix("docs/")
    return f"{REPOSITORY}/blob/HEAD/{file}"
