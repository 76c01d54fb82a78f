"""What a stranger finds: the package's description, its README as the index shows it, and the changelog."""

import importlib.util
import re
import tomllib
from pathlib import Path
from types import ModuleType

import pytest
from hatchling.metadata.core import ProjectMetadata
from hatchling.plugin.manager import PluginManager

import hatch_build
from app import __version__

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def prove_release() -> ModuleType:
    spec = importlib.util.spec_from_file_location("prove_release", ROOT / ".ci" / "prove_release.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def release(tmp_path: Path) -> Path:
    """A folder from which 1.2.3 may be released."""
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "__init__.py").write_text('__version__ = "1.2.3"\n')
    (tmp_path / "CHANGELOG.md").write_text(
        "# Changelog\n\n## 1.2.3 (2026-12-01)\n- new\n\n## 1.2.2 (2026-11-01)\n- old\n"
    )
    (tmp_path / "CITATION.cff").write_text("cff-version: 1.2.0\nversion: 1.2.3\n")
    (tmp_path / "pyproject.toml").write_text('Source = "https://example.org/team/voltwall"\n')
    return tmp_path


def test_links_become_absolute_and_only_the_relative_ones() -> None:
    text = "![a](b.png) [c](d/e.md#f) [g](https://h.example/) [i](#j) <k> [l](mailto:m@n.example)"
    assert hatch_build.absolute_links(text, "https://r.example") == (
        "![a](https://r.example/raw/HEAD/b.png) [c](https://r.example/blob/HEAD/d/e.md#f)"
        " [g](https://h.example/) [i](#j) <k> [l](mailto:m@n.example)"
    )


def test_the_package_describes_itself_with_links_that_lead_somewhere() -> None:
    core = ProjectMetadata(str(ROOT), PluginManager()).core
    assert core.readme_content_type == "text/markdown"
    links = re.findall(r"\]\(([^)\s]+)\)", core.readme)
    assert len(links) > 20
    assert [link for link in links if not link.startswith("https://")] == []
    assert any(link.endswith("/raw/HEAD/docs/images/overview.png") for link in links)
    assert {"Homepage", "Documentation", "Source", "Issues", "Changelog"} <= set(core.urls)
    assert all((core.authors, core.keywords, core.classifiers))


def test_the_classifiers_name_the_pythons_that_the_workflow_tests() -> None:
    named = {line.rsplit(" ", 1)[1] for line in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", line)}
    workflow = (ROOT / ".github" / "workflows" / "test.yml").read_text(encoding="utf-8")
    matrix = re.search(r"python: (\[.*\])", workflow)
    assert matrix is not None
    assert set(re.findall(r"3\.\d+", matrix[1])) == named


def test_the_changelog_begins_with_the_version_that_is_built() -> None:
    headings = re.findall(r"(?m)^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert next(name for name in headings if name != "Unreleased") == __version__
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"(?m)^version: (\S+)$", citation)[1] == __version__


def test_a_release_whose_files_agree_has_its_section(prove_release, release) -> None:
    assert prove_release.faults(release, "v1.2.3") == []
    assert prove_release.newest_section(release) == ("1.2.3 (2026-12-01)", "- new")


@pytest.mark.parametrize("tag", ["v1.2.4", "1.2.3", "v1.2.2"])
def test_a_tag_that_is_not_the_version_is_refused(prove_release, release, tag) -> None:
    assert any("the tag" in fault for fault in prove_release.faults(release, tag))


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("CHANGELOG.md", "## Unreleased\n- more\n\n## 1.2.3 (2026-12-01)\n"),
        ("CHANGELOG.md", "## 1.2.3 (not yet tagged)\n"),
        ("CITATION.cff", "cff-version: 1.2.0\nversion: 1.2.2\n"),
        ("pyproject.toml", 'Source = "https://github.com/OWNER/voltwall"\n'),
    ],
)
def test_a_file_that_does_not_agree_is_named(prove_release, release, file, text) -> None:
    (release / file).write_text(text)
    [fault] = prove_release.faults(release, "v1.2.3")
    assert file in fault
