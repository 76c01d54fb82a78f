-- Rows of a table that was imported: what one instant says of the battery, measured elsewhere. No frame explains them.
CREATE TABLE measurements (
    id INTEGER PRIMARY KEY,
    t_mono_ns INTEGER NOT NULL,
    t_wall_ns INTEGER NOT NULL,
    numbers BLOB NOT NULL     -- f64 little endian: current [A], SOC, voltage of each cell [V], each sensor [degC]; NaN: none
);

-- The number of the bus, 0 but in sessions of versions that read several. Until here it stood in bits 29 and 30 of can_id.
ALTER TABLE can_frames ADD COLUMN bus INTEGER NOT NULL DEFAULT 0;
UPDATE can_frames SET bus = can_id >> 29 & 3, can_id = can_id & ~(3 << 29) WHERE can_id >> 29 & 3;
