-- What each session told of each cell: what the Season page is computed from.
-- $battery = : name of the battery's profile; empty: of all
-- $segments = : cells of each pack as a JSON list; empty: of all
-- $simulated = 0: 1: of the simulated car
SELECT cells.car AS car, cells.session AS session, sessions.start_time AS start_time, cell,
       resistance_ohm, resistance_factor, resistance_factor_sigma,
       cells.charge_out_ah + cells.charge_in_ah AS charge_ah, capacity_ah, capacity_sigma_ah,
       first_rest_time, first_rest_soc, last_rest_time, last_rest_soc
FROM cells
JOIN sessions ON sessions.car = cells.car AND sessions.season = cells.season AND sessions.session = cells.session
WHERE lap = 0
  AND ($battery = '' OR battery = $battery)
  AND ($segments = '' OR segments = $segments)
  AND simulated = ($simulated = 1)
ORDER BY car, start_time, session, cell
