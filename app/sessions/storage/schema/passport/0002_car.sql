-- Whose they are, as the season lake names a car. NULL in what is older: it counts for every car.
ALTER TABLE records ADD COLUMN car TEXT;
ALTER TABLE swaps ADD COLUMN car TEXT;
