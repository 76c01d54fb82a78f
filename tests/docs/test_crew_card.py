"""The crew card has the banners and keys that the pages have."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CARD = (ROOT / "docs/howto/crew-card.md").read_text(encoding="utf-8")
SOURCES = [*(ROOT / "frontend/src").rglob("*.svelte"), *(ROOT / "app/words").rglob("*.json")]
KEYS = (ROOT / "frontend/src/store/keys.svelte.ts").read_text(encoding="utf-8")
BANNERS = re.findall(r"^\| ([^|]+?) \|", CARD.partition("| Banner |")[2].partition("\n\n")[0], re.MULTILINE)[1:]


@pytest.mark.parametrize("banner", [banner.partition(",")[0] for banner in BANNERS])
def test_a_banner_is_one_of_the_pages(banner: str) -> None:
    assert any(banner in file.read_text(encoding="utf-8").replace("’", "'") for file in SOURCES)


def test_the_keys_are_those_of_the_pages() -> None:
    named = re.findall(r"\| `(.)` \|", CARD)
    assert len(named) == 6
    assert [key for key in named if f"key: '{key}'" not in KEYS and key != "?"] == []  # `?` opens their list
