-- What happened around every trip; kept when the session it was in is deleted.
CREATE TABLE blackboxes (
    id TEXT PRIMARY KEY,          -- UTC time and code
    t_wall_ns INTEGER NOT NULL,
    session_id TEXT,
    code TEXT NOT NULL,
    severity TEXT NOT NULL,
    cell INTEGER,
    text TEXT NOT NULL,
    is_complete INTEGER NOT NULL, -- 1: samples from before to after
    body BLOB NOT NULL            -- zlib of the JSON document
) WITHOUT ROWID;

CREATE INDEX blackboxes_by_time ON blackboxes (t_wall_ns);
