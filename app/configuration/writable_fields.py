"""Which fields of the configuration a write may change while the accumulator drives, charges or balances."""

from firmware_protocol.memory_map import CONFIG

FIELDS_WRITABLE_AT_WORK = tuple(name for name, field in CONFIG.items() if field.is_live)
