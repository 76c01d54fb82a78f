-- What every session told about the cells, and which modules were swapped; kept when a session is deleted.
CREATE TABLE records (
    session_id TEXT PRIMARY KEY,
    start_wall_ns INTEGER NOT NULL,
    body BLOB NOT NULL            -- zlib of the JSON document
) WITHOUT ROWID;

CREATE TABLE swaps (
    id INTEGER PRIMARY KEY,
    t_wall_ns INTEGER NOT NULL,   -- from then on it is another module
    cells TEXT NOT NULL,          -- JSON list of indices from 0
    note TEXT NOT NULL,
    who TEXT
);
