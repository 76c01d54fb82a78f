-- Charge that each cell has delivered up to each session.
-- $car = : name of the car; empty: of each
SELECT car, pack, cell_in_pack, start_time, session, charge_out_ah,
       sum(charge_out_ah) OVER (PARTITION BY car, cell ORDER BY start_time, session) AS so_far_ah
FROM cells
WHERE lap = 0 AND ($car = '' OR car = $car)
ORDER BY car, pack, cell_in_pack, start_time, session
