"""The table of the last campaign: a part that runs alone renews its own row."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def campaign(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / ".ci"))
    import campaign

    return campaign


def test_a_part_that_runs_alone_leaves_the_rows_of_the_others(campaign, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"# Before\n{campaign.BEGIN}\n{campaign.END}\n\nAfter\n", encoding="utf-8")
    soak, noise = (campaign.Part("It lasts", f"tests/{name}.py", 1, "held", held=True) for name in ("soak", "noise"))
    campaign.write_table(page, "full", "2026-11-01", [soak, noise])
    campaign.write_table(page, "long", "2026-11-02", [soak])
    campaign.write_table(page, "full", "2026-11-03", [campaign.Part("It lasts", "tests/soak.py", 2, "1 FAILED", False)])
    text = page.read_text(encoding="utf-8")
    assert text.startswith("# Before\n")
    assert text.endswith("\n\nAfter\n")
    rows = [[cell.strip() for cell in line.split("|")] for line in text.splitlines() if line.startswith("| It")]
    assert [(row[2], row[3], row[4], row[6], row[7]) for row in rows] == [
        ("`tests/noise.py`", "full", "2026-11-01", "1", "held"),
        ("`tests/soak.py`", "full", "2026-11-03", "2", "1 FAILED"),
        ("`tests/soak.py`", "long", "2026-11-02", "1", "held"),
    ]


def test_every_test_of_the_campaign_exists(campaign):
    for each in (*campaign.TESTS, *campaign.ALONE, *campaign.FULL_ONLY):
        file, _, name = each.partition("::")
        assert name in (ROOT / file).read_text(encoding="utf-8")
    assert campaign.promise_of("tests/integration/test_soak.py").startswith("Hours of everything at once")
