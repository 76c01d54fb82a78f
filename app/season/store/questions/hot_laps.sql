-- Laps in which a cell was hotter than so many degrees.
-- $degc = 35: degrees Celsius
-- $car = : name of the car; empty: of each
SELECT car, session, lap, start_time, driver, duration_s, temperature_max_degc
FROM laps
WHERE temperature_max_degc > $degc AND ($car = '' OR car = $car)
ORDER BY start_time, car, session, lap
