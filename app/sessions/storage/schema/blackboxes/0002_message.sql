-- What the box's event tells as code and arguments, in JSON; null in rows of before, which have their English text alone.
ALTER TABLE blackboxes ADD COLUMN message TEXT;
