-- What people settled about a session afterwards: laps, for one. The newest value of each key counts.
CREATE TABLE notes (
    key TEXT PRIMARY KEY,
    value TEXT NOT NULL,          -- JSON
    t_wall_ns INTEGER NOT NULL,   -- when it was said
    who TEXT
) WITHOUT ROWID;
