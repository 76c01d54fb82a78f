"""Where a configuration of the first memory map comes from."""

from types import SimpleNamespace

from app.configuration.config_sources import ConfigSources
from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import CONFIG


def test_a_record_of_the_first_map_is_converted() -> None:
    now = default_image()
    first = (250).to_bytes(2, "little") + now[2:226] + bytes(2) + now[228:]
    record = SimpleNamespace(before=first, after=now)
    history = SimpleNamespace(record=lambda _: record)
    found = ConfigSources(None, lambda: None, None, history, None)
    assert found.image("record:1") == now
    before = found.image("record:1:before")
    assert [CONFIG[name].unpack(before)[0] for name in ("telemetry_period", "ts")] == [250, 100]
