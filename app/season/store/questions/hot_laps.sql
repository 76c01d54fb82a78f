-- Laps in which a cell was hotter than so many degrees.
-- $degc = 35: degrees Celsius
SELECT session, lap, start_time, driver, duration_s, temperature_max_degc
FROM laps
WHERE temperature_max_degc > $degc
ORDER BY start_time
