-- Warnings and trips of the season, the latest first.
-- $car = : name of the car; empty: of each
SELECT time, car, session, lap, severity, code, text, cell, value, limit_value, unit
FROM events
WHERE severity <> 'info' AND ($car = '' OR car = $car)
ORDER BY time DESC
