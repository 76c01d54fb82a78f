"""The image and the compose file keep what docs/howto/recorder.md promises."""

import json
import re
from pathlib import Path

from app.service.health import probe
from app.service.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")
LAST_STAGE = DOCKERFILE[DOCKERFILE.rindex("\nFROM ") :]
COMPOSE = (ROOT / "compose.yaml").read_text(encoding="utf-8")
VARIABLES = {f"VOLTWALL_{name.upper()}" for name in Settings.model_fields}


def test_the_service_does_not_run_as_root() -> None:
    user = re.search(r"^USER (\S+)$", LAST_STAGE, re.MULTILINE)[1]
    assert re.search(rf"useradd .*--groups dialout {user}\b", LAST_STAGE)
    assert LAST_STAGE.index("\nUSER ") < LAST_STAGE.index("\nCMD ")


def test_the_default_command_is_the_service_on_the_volume() -> None:
    command = json.loads(re.search(r"^CMD (\[.*\])$", LAST_STAGE, re.MULTILINE)[1])
    volume = re.search(r"^VOLUME (\S+)$", LAST_STAGE, re.MULTILINE)[1]
    assert command == ["voltwall", "serve"]
    assert f"ENV VOLTWALL_DATA={volume}\n" in LAST_STAGE


def test_the_health_check_is_the_probe() -> None:
    command = json.loads(re.search(r"^HEALTHCHECK .* CMD (\[.*\])$", LAST_STAGE, re.MULTILINE)[1])
    assert command == ["python", "-P", "-m", f"voltwall.{probe.__name__}"]  # where the wheel has it


def test_the_override_of_several_devices_adds_to_the_service_that_there_is() -> None:
    guide = (ROOT / "docs" / "howto" / "recorder.md").read_text(encoding="utf-8")
    [override] = re.findall(r"```yaml\n(.*?)```", guide, re.DOTALL)
    places = [line for line in override.splitlines() if line.endswith(":")]
    assert places == ["services:", "  voltwall:", "    devices:"]
    assert all(f"\n{place}\n" in f"\n{COMPOSE}" for place in places)
    assert re.findall(r"^      - (\S+)$", override, re.MULTILINE)[0] == "/dev/ttyACM0"


def test_image_and_compose_set_only_settings_that_exist() -> None:
    named = set(re.findall(r"VOLTWALL_[A-Z_]+", DOCKERFILE + COMPOSE))
    assert {"VOLTWALL_PASSWORD", "VOLTWALL_SERIAL", "VOLTWALL_CAN", "VOLTWALL_HOST"} <= named
    assert named - VARIABLES == set()


def test_compose_passes_on_every_setting_that_the_image_does_not_fix() -> None:
    passed = set(re.findall(r"^      (VOLTWALL_[A-Z_]+):", COMPOSE, re.MULTILINE))
    fixed = set(re.findall(r"^ENV (VOLTWALL_[A-Z_]+)=", LAST_STAGE, re.MULTILINE))
    assert passed | fixed == VARIABLES
    assert not passed & fixed


def test_a_variable_that_is_passed_on_empty_counts_as_not_set(monkeypatch) -> None:
    for name in ("SERIAL", "CAN", "KEEP_GB", "RECORD"):
        monkeypatch.setenv(f"VOLTWALL_{name}", "")
    assert Settings().simulates
    assert Settings().record


def test_what_the_image_installs_publishes_and_reads_a_dbc() -> None:
    lock = (ROOT / "requirements" / "run.lock").read_text(encoding="utf-8")
    assert {"paho-mqtt", "cantools", "pyarrow", "mcap"} <= set(re.findall(r"^([a-z-]+)==", lock, re.MULTILINE))


def test_compose_restarts_by_itself_and_asks_for_a_password() -> None:
    assert re.search(r"^    restart: unless-stopped$", COMPOSE, re.MULTILINE)
    assert "${VOLTWALL_PASSWORD:?" in COMPOSE


def test_compose_gives_it_nothing_but_the_volume_and_the_devices() -> None:
    for line in ("read_only: true", "cap_drop: [ALL]", 'security_opt: ["no-new-privileges:true"]'):
        assert re.search(rf"^    {re.escape(line)}( #|$)", COMPOSE, re.MULTILINE), line
    assert not re.search(r"^    (privileged|cap_add|pid|ipc|user):", COMPOSE, re.MULTILINE)
    volumes = re.search(r"^    volumes:\n((?:      .*\n)+)", COMPOSE, re.MULTILINE)[1]
    assert volumes == "      - sessions:/data\n"


def test_what_is_made_on_the_way_lies_in_the_volume() -> None:
    assert "ENV TMPDIR=/data/tmp\n" in LAST_STAGE
    assert re.search(r"^RUN .*install -d -o voltwall -g voltwall /data /data/tmp$", LAST_STAGE, re.MULTILINE)


def test_no_password_stands_in_the_image_or_the_compose_file() -> None:
    assert not re.search(r"PASSWORD[=:] *[A-Za-z0-9]", DOCKERFILE + COMPOSE)
