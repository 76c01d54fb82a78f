from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import CONFIG, FIELDS
from simulator.memory import FLAG, Config, MasterMemory


def value(memory: MasterMemory, name: str) -> int:
    return FIELDS[name].unpack(memory.image)[0]


def test_summaries_land_in_the_fields_of_the_map():
    memory = MasterMemory()
    memory.set_currents(-5, -4, -1)
    memory.set_voltage_summary(40594, 40794, 40725, 6, 1, 38_000)
    memory.set_temperature_summary(-8, 7, -2, 1, 5)
    memory.set_charge(24079, 9991)
    memory.set_slave_count(7)
    memory.set_can_masks(3, 1, 1)
    memory.set_charger("i_set", 120)
    memory.flags = FLAG["fit"] | FLAG["load"]
    expected = {
        "i_fs": -5, "i_fc": -4, "i_fc_hp": -1, "v_min": 40594, "v_max": 40794, "v_avg": 40725, "v_min_id": 6,
        "v_max_id": 1, "v_tot": 38_000, "t_min": -8, "t_max": 7, "t_avg": -2, "t_min_id": 1, "t_max_id": 5,
        "dod": 24079, "soc": 9991, "n_slaves": 7, "status.can_tx_msg_en": 3, "status.can_rx_msg_en": 1,
        "status.can_rx_msg_active": 1, "charger.i_set": 120, "status.flags": 0b1_0000_0001,
    }  # fmt: skip
    assert {name: value(memory, name) for name in expected} == expected


def test_arrays_are_windows_onto_the_struct():
    memory = MasterMemory()
    memory.v[36] = 37_000
    memory.t[95] = -7
    memory.slave_cvr[3, 11] = 0xFFFF
    memory.slave_cfgr[7, 4] = 0x55
    assert FIELDS["v"].unpack(memory.image)[36] == 37_000
    assert FIELDS["t"].unpack(memory.image)[95] == -7
    assert FIELDS["slave[3].cvr"].unpack(memory.image)[11] == 0xFFFF
    assert FIELDS["slave[7].cfgr"].unpack(memory.image)[4] == 0x55


def test_config_reads_every_scalar_of_the_configuration():
    config = Config.from_image(default_image())
    scalars = {name for name, field in CONFIG.items() if not field.shape}
    assert scalars == set(Config.__dataclass_fields__)
    assert all(getattr(config, name) == CONFIG[name].default for name in scalars)
