-- Lowest voltage of each cell in each lap.
-- $car = : name of the car; empty: of each
SELECT car, session, lap, pack, cell_in_pack, min(voltage_min_v) AS voltage_min_v
FROM cells
WHERE lap > 0 AND ($car = '' OR car = $car)
GROUP BY car, session, lap, pack, cell_in_pack
ORDER BY car, session, lap, pack, cell_in_pack
