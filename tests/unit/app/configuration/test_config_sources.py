"""An edit of a named source starts from what is there when the write has begun."""

from types import SimpleNamespace

from app.configuration.config_sources import ConfigSources, SourceEdit
from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import CONFIG


def raised(image: bytes) -> bytes:
    changed = bytearray(image)
    CONFIG["telemetry_period"].pack_into(changed, (500,))
    return bytes(changed)


def sources(streamed: bytes) -> ConfigSources:
    return ConfigSources(None, lambda: streamed, None, None, None)


def test_in_force_is_the_image_just_read_not_the_one_last_streamed() -> None:
    read = bytearray(default_image())
    CONFIG["v_cell_max"].pack_into(read, (41500,))
    assert bytes(read) != default_image()
    wanted = SourceEdit(SimpleNamespace(applied_to=raised), "in-force", sources(default_image())).applied_to(
        bytes(read)
    )
    assert wanted == raised(bytes(read))


def test_another_source_replaces_what_is_in_force() -> None:
    read = raised(default_image())
    assert read != default_image()
    wanted = SourceEdit(SimpleNamespace(applied_to=bytes), "default", sources(read)).applied_to(read)
    assert wanted == default_image()


def test_a_record_of_the_first_map_is_converted() -> None:
    now = default_image()
    first = (250).to_bytes(2, "little") + now[2:226] + bytes(2) + now[228:]
    record = SimpleNamespace(before=first, after=now)
    history = SimpleNamespace(record=lambda _: record)
    found = ConfigSources(None, lambda: None, None, history, None)
    assert found.image("record:1") == now
    before = found.image("record:1:before")
    assert [CONFIG[name].unpack(before)[0] for name in ("telemetry_period", "ts")] == [250, 100]
