-- A session: everything received, in order, and what was made of it.
-- t_mono_ns: monotonic clock of the recording machine, the time axis. t_wall_ns: its wall clock, since 1970 UTC;
-- it may step, so nothing is ordered by it. uptime_ms: the master's own clock, starts again with each of its boots.

-- id, name, voltwall (version), map_hash, t_mono_ns and t_wall_ns of the start; of the end once closed; what the caller gave, as JSON
CREATE TABLE meta (
    key TEXT PRIMARY KEY,
    value TEXT NOT NULL
) WITHOUT ROWID;

CREATE TABLE frames (
    id INTEGER PRIMARY KEY,
    t_mono_ns INTEGER NOT NULL,
    t_wall_ns INTEGER NOT NULL,
    link INTEGER NOT NULL,
    ok INTEGER NOT NULL,      -- 1: the checksum held
    raw BLOB NOT NULL         -- what stood between two delimiters on the line
);

CREATE TABLE can_frames (
    id INTEGER PRIMARY KEY,
    t_mono_ns INTEGER NOT NULL,
    t_wall_ns INTEGER NOT NULL,
    can_id INTEGER NOT NULL,  -- bit 31 marks a 29-bit id
    data BLOB NOT NULL
);

-- Estimates since the last chunk was closed; older ones are columns named estimate.soc and estimate.soc_sigma.
CREATE TABLE estimates (
    id INTEGER PRIMARY KEY,
    t_mono_ns INTEGER NOT NULL,
    uptime_ms INTEGER NOT NULL,
    soc BLOB NOT NULL,        -- u16 little endian per cell, 2e-5 per count, 65535 missing
    sigma BLOB NOT NULL
);

CREATE TABLE events (
    id INTEGER PRIMARY KEY,
    t_mono_ns INTEGER NOT NULL,
    t_wall_ns INTEGER NOT NULL,
    severity TEXT NOT NULL,
    code TEXT NOT NULL,
    text TEXT NOT NULL,
    cell INTEGER,
    value REAL,
    limit_value REAL,
    unit TEXT NOT NULL,
    who TEXT
);

CREATE TABLE markers (
    id INTEGER PRIMARY KEY,
    t_mono_ns INTEGER NOT NULL,
    t_wall_ns INTEGER NOT NULL,
    kind TEXT NOT NULL,
    text TEXT NOT NULL,
    who TEXT
);

CREATE TABLE configs (
    id INTEGER PRIMARY KEY,
    t_mono_ns INTEGER NOT NULL,
    t_wall_ns INTEGER NOT NULL,
    why TEXT NOT NULL,
    image BLOB NOT NULL       -- the 420 bytes in force
);

CREATE TABLE clock (
    id INTEGER PRIMARY KEY,
    t_mono_ns INTEGER NOT NULL,
    t_wall_ns INTEGER NOT NULL,
    uptime_ms INTEGER
);

-- A chunk is about a minute, decoded while recording so that a signal of hours is read without decoding its frames.
-- All of it can be made again from frames and estimates, except estimates that were moved here.
CREATE TABLE chunks (
    id INTEGER PRIMARY KEY,
    first_frame INTEGER NOT NULL,  -- frames.id, inclusive
    last_frame INTEGER NOT NULL,   -- first_frame - 1: none
    bad_frames INTEGER NOT NULL,
    first_us INTEGER NOT NULL,     -- of the samples, monotonic
    last_us INTEGER NOT NULL,
    boots INTEGER NOT NULL,        -- times that the master's clock had gone back, at the chunk's end
    last_uptime_ms INTEGER         -- the master's clock in the last frame
);

-- What the columns hold: elements of one field of the memory map, or of an estimate.
CREATE TABLE series (
    id INTEGER PRIMARY KEY,
    field TEXT NOT NULL,
    first_element INTEGER NOT NULL,
    elements INTEGER NOT NULL,
    dtype TEXT NOT NULL            -- numpy: <u2, |i1, ...
);

-- Sample times that columns of a chunk share. id = chunk * 2**20 + number of the track in the chunk.
CREATE TABLE tracks (
    id INTEGER PRIMARY KEY,
    samples INTEGER NOT NULL,
    times_us BLOB NOT NULL,        -- i64 monotonic, as a stream
    instants BLOB NOT NULL         -- i64 boot * 2**32 + uptime_ms, as a stream
);

-- id = chunk * 2**20 + series. ends: u32 per element, where its stream in data ends.
-- A stream is one value (all samples equal it) or zlib of the byte planes of zigzag differences.
CREATE TABLE columns (
    id INTEGER PRIMARY KEY,
    track INTEGER NOT NULL,
    ends BLOB NOT NULL,
    data BLOB NOT NULL
);
