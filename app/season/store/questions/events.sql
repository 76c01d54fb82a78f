-- Warnings and trips of the season, the latest first.
SELECT time, session, lap, severity, code, text, cell, value, limit_value, unit
FROM events
WHERE severity <> 'info'
ORDER BY time DESC
