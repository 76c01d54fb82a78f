"""The master's memory map, the wire, the CAN tables, the chips: everything both ends must agree on."""
