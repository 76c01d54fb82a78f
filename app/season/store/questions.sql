-- The bundled queries. Each begins with `-- NAME: what it returns`, then a line for each parameter: `-- $name = default: meaning`.

-- drivers: Laps, lap time and energy of each driver in each car.
-- $car = : name of the car; empty for all cars
SELECT car, driver, count(*) AS laps, min(duration_s) AS best_lap_s, avg(duration_s) AS mean_lap_s,
       avg(energy_out_wh - energy_in_wh) AS energy_wh, avg(power_mean_w) AS power_mean_w
FROM laps
WHERE counts AND ($car = '' OR car = $car)
GROUP BY car, driver
ORDER BY car, mean_lap_s, driver

-- events: Warnings and trips of the season, the latest first.
-- $car = : name of the car; empty for all cars
SELECT time, car, session, lap, severity, code, text, cell, value, limit_value, unit
FROM events
WHERE severity <> 'info' AND ($car = '' OR car = $car)
ORDER BY time DESC

-- findings: Findings of each cell, with the number of sessions.
-- $car = : name of the car; empty for all cars
SELECT car, pack, cell_in_pack, findings,
       count(*) AS sessions, min(start_time) AS first_time, max(start_time) AS last_time
FROM cells
WHERE lap = 0 AND findings <> '' AND ($car = '' OR car = $car)
GROUP BY car, pack, cell_in_pack, findings
ORDER BY sessions DESC, car, pack, cell_in_pack, findings

-- hot_laps: Laps in which a cell was hotter than degc.
-- $degc = 35: temperature limit in degrees Celsius
-- $car = : name of the car; empty for all cars
SELECT car, session, lap, start_time, driver, duration_s, temperature_max_degc
FROM laps
WHERE temperature_max_degc > $degc AND ($car = '' OR car = $car)
ORDER BY start_time, car, session, lap

-- lowest_voltage: Lowest voltage of each cell in each lap.
-- $car = : name of the car; empty for all cars
SELECT car, session, lap, pack, cell_in_pack, min(voltage_min_v) AS voltage_min_v
FROM cells
WHERE lap > 0 AND ($car = '' OR car = $car)
GROUP BY car, session, lap, pack, cell_in_pack
ORDER BY car, session, lap, pack, cell_in_pack

-- near_limits: Time of each cell near the limits of its session, the longest first.
-- $car = : name of the car; empty for all cars
SELECT car, pack, cell_in_pack,
       sum(near_v_min_s) AS near_v_min_s,
       sum(near_v_max_s) AS near_v_max_s,
       sum(near_t_max_s) AS near_t_max_s
FROM cells
WHERE lap = 0 AND ($car = '' OR car = $car)
GROUP BY car, pack, cell_in_pack
ORDER BY near_v_min_s DESC, near_t_max_s DESC, car, pack, cell_in_pack

-- ranking: Cells by resistance relative to the median cell of their session, the highest first.
-- $car = : name of the car; empty for all cars
WITH medians AS (
    SELECT car, session, median(resistance_ohm) AS usual_ohm
    FROM cells
    WHERE lap = 0
    GROUP BY car, session
)
SELECT cells.car AS car, pack, cell_in_pack,
       count(resistance_ohm) AS sessions,
       100 * (avg(resistance_ohm / usual_ohm) - 1) AS above_median_percent,
       1000 * avg(sag_v) AS sag_mv,
       sum(lowest_s) AS lowest_s,
       min(voltage_min_v) AS voltage_min_v,
       max(temperature_max_degc) AS temperature_max_degc
FROM cells
JOIN medians ON medians.car = cells.car AND medians.session = cells.session
WHERE lap = 0 AND ($car = '' OR cells.car = $car)
GROUP BY cells.car, pack, cell_in_pack
ORDER BY above_median_percent DESC, car, pack, cell_in_pack

-- resistance: Resistance of each cell over the season, with its sigma, temperature and SOC.
-- $car = : name of the car; empty for all cars
SELECT start_time, session, car, pack, cell_in_pack,
       1000 * resistance_ohm AS resistance_mohm,
       1000 * resistance_sigma_ohm AS sigma_mohm,
       temperature_mean_degc, soc_mean
FROM cells
WHERE lap = 0 AND resistance_ohm IS NOT NULL AND ($car = '' OR car = $car)
ORDER BY car, pack, cell_in_pack, start_time, session

-- season_cells: Results of each session for each cell, from which the Season page is computed.
-- $battery = : name of the battery profile; empty for all
-- $segments = : cells of each pack as a JSON list; empty for all
-- $simulated = 0: 1 for the simulated car
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

-- signal: Any signal of all sessions: lowest, mean and highest value of each minute.
-- $signal = v[36]: name of the signal, as in an export
-- $car = : name of the car; empty for all cars
SELECT car, session, date_trunc('minute', time) AS minute,
       min("$signal") AS lowest, avg("$signal") AS mean, max("$signal") AS highest
FROM samples
WHERE $car = '' OR car = $car
GROUP BY car, session, minute
ORDER BY car, session, minute

-- throughput: Charge that each cell has delivered up to each session.
-- $car = : name of the car; empty for all cars
SELECT car, pack, cell_in_pack, start_time, session, charge_out_ah,
       sum(charge_out_ah) OVER (PARTITION BY car, cell ORDER BY start_time, session) AS so_far_ah
FROM cells
WHERE lap = 0 AND ($car = '' OR car = $car)
ORDER BY car, pack, cell_in_pack, start_time, session
