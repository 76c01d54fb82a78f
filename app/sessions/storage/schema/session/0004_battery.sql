-- The battery's profile, then what it includes and its DBCs, as files; none: the team's own, by its memory map.
CREATE TABLE battery_files (
    id INTEGER PRIMARY KEY,
    name TEXT NOT NULL,           -- as the profile names it
    data BLOB NOT NULL
);
