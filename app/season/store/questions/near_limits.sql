-- Time that each cell spent near the limits of then, the longest first.
-- $car = : name of the car; empty: of each
SELECT car, pack, cell_in_pack,
       sum(near_v_min_s) AS near_v_min_s,
       sum(near_v_max_s) AS near_v_max_s,
       sum(near_t_max_s) AS near_t_max_s
FROM cells
WHERE lap = 0 AND ($car = '' OR car = $car)
GROUP BY car, pack, cell_in_pack
ORDER BY near_v_min_s DESC, near_t_max_s DESC, car, pack, cell_in_pack
