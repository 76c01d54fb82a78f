-- What was found of which cell, and in which sessions.
-- $car = : name of the car; empty: of each
SELECT car, pack, cell_in_pack, findings,
       count(*) AS sessions, min(start_time) AS first_time, max(start_time) AS last_time
FROM cells
WHERE lap = 0 AND findings <> '' AND ($car = '' OR car = $car)
GROUP BY car, pack, cell_in_pack, findings
ORDER BY sessions DESC, car, pack, cell_in_pack, findings
