"""`voltwall config` as a script uses it: by its output and its exit codes."""

import json

import pytest


@pytest.fixture
def config(voltwall, make_service):
    service = make_service("--scenario", "in-the-pit")
    service.wait_for(lambda s: s["config_hash"] and s["master"]["map_matches"])
    return lambda *words: voltwall("config", "--url", service.base_url, *words)


def test_read_compare_write_store_and_roll_back(config, tmp_path):
    assert json.loads(config("read").stdout)["telemetry_period"] == 100
    image = tmp_path / "image.bin"
    assert config("read", "--out", str(image)).returncode == 0
    assert image.stat().st_size == 420
    assert config("diff", str(image)).returncode == 0

    different = config("diff", "t_cell_max=50")
    assert (different.returncode, different.stdout.strip()) == (1, "t_cell_max: 45 -> 50 degC")
    as_json = config("diff", "t_cell_max=50", "--json")
    (change,) = json.loads(as_json.stdout)["difference"]
    assert (as_json.returncode, change["field"], change["from"], change["to"]) == (1, "t_cell_max", 45, 50)
    written = config("write", "t_cell_max=50", "--store")
    assert written.returncode == 0, written.stderr
    assert "read back and equal" in written.stdout
    assert "counter" in written.stdout

    for edit, words in (
        ("t_cell_max=500", "t_cell_max"),
        ("t_cell_max=61", "rule limit"),
        ("telemetry_period=fast", "number"),
    ):
        refused = config("write", edit)
        assert refused.returncode == 2
        assert words in refused.stderr

    doubtful = config("write", "i_disc_max=210")
    assert doubtful.returncode == 2
    assert "--reason" in doubtful.stderr
    assert config("write", "i_disc_max=210", "--reason", "ten second pulses").returncode == 0

    assert config("rollback").returncode == 0
    assert config("compare", "stored", "in-force").returncode == 0
    history = json.loads(config("history", "--json").stdout)
    assert [r["action"] for r in history] == ["rollback", "write", "store", "write"]
    assert history[1]["reason"] == "ten second pulses"
    assert all(r["genuine"] and r["result"] == "done" for r in history)
    heads, rolled_back, written = config("history").stdout.splitlines()[:3]
    assert heads.split() == ["#", "time", "who", "what", "result", "change", "reason"]
    assert "i_disc_max: 210.0 -> 200.0 A" in rolled_back
    assert written.endswith("i_disc_max: 200.0 -> 210.0 A  ten second pulses")
    assert config("rollback", "1").returncode == 0
    assert config("diff", str(image)).returncode == 0
    assert config("load").returncode == 0
    assert json.loads(config("read").stdout)["t_cell_max"] == 50


def test_profiles_go_out_to_git_and_come_back(config, tmp_path):
    assert config("profiles", "save", "dry", "--comment", "as in the rules").returncode == 0
    file = tmp_path / "wet.json"
    assert config("profiles", "get", "dry", "--out", str(file)).returncode == 0
    file.write_text(file.read_text().replace('"t_cell_max": {"value": 45', '"t_cell_max": {"value": 55'))
    assert config("profiles", "put", str(file), "--as", "wet").stdout.startswith("wet@1 ")
    assert config("profiles", "save", "wet").stdout.startswith("wet@2 ")
    rows = [line.split() for line in config("profiles").stdout.splitlines()]
    assert [row[0] for row in rows] == ["profile", "dry@1", "wet@2"]
    assert " ".join(rows[1][2:]) == "as in the rules"

    compared = config("compare", "profile:dry", "profile:wet@1")
    assert (compared.returncode, compared.stdout.strip()) == (1, "t_cell_max: 45 -> 55 degC")
    assert config("write", "profile:wet@1").returncode == 0
    as_json = json.loads(config("compare", "profile:dry", "profile:wet@1", "--json").stdout)
    assert [change["field"] for change in as_json["difference"]] == ["t_cell_max"]
    assert as_json["b"]["source"].startswith("profile:wet@1")
    assert config("compare", "in-force", "profile:wet@1").returncode == 0
    assert config("diff", str(file)).returncode == 0, "the file itself can be written too"
    assert config("profiles", "delete", "dry").returncode == 0
    missing = config("write", "profile:dry")
    assert (missing.returncode, "dry" in missing.stderr) == (2, True)
    assert config("compare", "nonsense", "stored").returncode == 2


def test_without_an_earlier_write_there_is_nothing_to_roll_back(config):
    nothing = config("rollback")
    assert (nothing.returncode, nothing.stdout) == (2, "")
    assert nothing.stderr == "voltwall config: nothing to roll back: the history holds no write that was done\n"
    unknown = config("rollback", "7")
    assert unknown.returncode == 2
    assert "record 7" in unknown.stderr


def test_nobody_there_is_told_by_the_exit_code(voltwall):
    result = voltwall("config", "--url", "http://127.0.0.1:9", "store")
    assert (result.returncode, result.stderr.count("\n")) == (3, 1)
