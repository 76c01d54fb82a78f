"""The unit of docs/howto/recorder.md is one that systemd takes, and asks for what the service does."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from app.service.health import watchdog
from app.service.links import STUCK_S
from app.service.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
UNIT = (ROOT / "docs" / "examples" / "voltwall.service").read_text(encoding="utf-8")
PAGE = (ROOT / "docs" / "howto" / "recorder.md").read_text(encoding="utf-8")
HOWTO = PAGE.partition("\n## With systemd\n")[2].partition("\n## ")[0]
LINES = [line.partition("=")[::2] for line in UNIT.splitlines() if re.match(r"\w+=", line)]
SET = dict(LINES)


def test_systemd_is_told_and_waits_longer_than_a_sign_of_life_takes() -> None:
    assert (SET["Type"], SET["NotifyAccess"], SET["Restart"]) == ("notify", "main", "always")
    signs_s = watchdog.period_s({"WATCHDOG_USEC": f"{int(SET['WatchdogSec'])}000000"})
    assert signs_s is not None
    assert signs_s * 2 < int(SET["WatchdogSec"])
    assert f"{signs_s:.0f}" == "10", "as the page says"
    assert f"for {STUCK_S:.0f} s" in HOWTO


def test_it_has_no_powers_and_writes_in_its_own_folder() -> None:
    assert SET["User"] not in ("", "root")
    assert SET["SupplementaryGroups"] == "dialout"
    assert SET["CapabilityBoundingSet"] == SET["AmbientCapabilities"] == ""
    assert (SET["NoNewPrivileges"], SET["ProtectSystem"], SET["ProtectHome"]) == ("yes", "strict", "yes")
    assert f"Environment=VOLTWALL_DATA=/var/lib/{SET['StateDirectory']}\n" in UNIT
    assert "AF_CAN" in SET["RestrictAddressFamilies"]
    assert SET["LimitCORE"] == "0"


def test_unit_and_page_name_only_settings_that_exist() -> None:
    named = set(re.findall(r"VOLTWALL_([A-Z_]+)=", UNIT + HOWTO))
    assert {name.lower() for name in named} <= set(Settings.model_fields)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not here")
def test_systemd_takes_it(tmp_path) -> None:
    unit = tmp_path / "voltwall.service"
    unit.write_text(UNIT.replace("/opt/voltwall/bin/voltwall", sys.executable), encoding="utf-8")
    found = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True, check=False
    )
    assert [line for line in found.stderr.splitlines() if "voltwall.service" in line] == []
