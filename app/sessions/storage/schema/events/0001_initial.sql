-- The event log: what happened, over all sessions and restarts.
CREATE TABLE events (
    id INTEGER PRIMARY KEY,
    t_wall_ns INTEGER NOT NULL,   -- since 1970 UTC; the order is the id's, because wall clocks step
    uptime_ms INTEGER,            -- the master's clock, where the event has one
    severity TEXT NOT NULL,
    code TEXT NOT NULL,
    text TEXT NOT NULL,
    cell INTEGER,
    value REAL,
    limit_value REAL,
    unit TEXT NOT NULL,
    who TEXT,
    acknowledged_by TEXT,
    acknowledged_ns INTEGER
);

CREATE INDEX events_cell ON events (cell) WHERE cell IS NOT NULL;
