import pytest

from app.errors import ConfigError
from app.sessions.export.export import export
from app.sessions.export.formats import FORMATS, Names
from app.sessions.export.table import AGE, export_name
from app.sessions.reading.reader import SessionFile
from app.sessions.storage.signals import Signals
from app.sources.loaded_battery import team_battery

SIGNALS = Signals(team_battery())
SEGMENTS = team_battery().battery.segments


@pytest.mark.parametrize(
    ("signal", "number", "pack"),
    [
        ("v[0]", "v_001", "pack1_cell1_v"),
        ("v[36]", "v_037", "pack4_cell1_v"),
        ("t[95]", "t_096", "pack8_cell12_t"),
        ("estimate.soc[11]", "estimate_soc_012", "pack1_cell12_estimate_soc"),
        ("slave[3].cvr[5]", "slave_004_cvr_006", "slave_004_cvr_006"),
        ("conf.can_tx_msg_data[2][3]", "conf_can_tx_msg_data_003_004", "conf_can_tx_msg_data_003_004"),
        ("i_fs", "i_fs", "i_fs"),
        ("conf.ts", "conf_ts", "conf_ts"),
    ],
)
def test_names_that_tools_take_count_from_one(signal: str, number: str, pack: str) -> None:
    found = {
        names: export_name(SIGNALS.find(signal), names, SIGNALS, SEGMENTS) for names in ("index", "number", "pack")
    }
    assert found == {"index": signal, "number": number, "pack": pack}


@pytest.mark.parametrize("names", ["number", "pack"])
def test_every_signal_has_a_name_of_its_own_that_is_a_word(names: Names) -> None:
    signals = [SIGNALS.find(name) for field in SIGNALS.order for name in SIGNALS.names(field)]
    found = [export_name(signal, names, SIGNALS, SEGMENTS) for signal in [*signals, AGE]]
    assert len(set(found)) == len(found)
    assert all(name.isidentifier() for name in found)


@pytest.mark.parametrize("name", [name for name, each in FORMATS.items() if not each.has_names])
def test_a_format_that_names_its_signals_itself_says_so(recorder, tmp_path, name: str) -> None:
    info = recorder.start()
    recorder.flush()
    with SessionFile(info.path) as session, pytest.raises(ConfigError, match="names = pack: one of index"):
        export(session, tmp_path / "a", name, names="pack")
