-- Laps, lap time and energy of each driver in each car.
-- $car = : name of the car; empty: of each
SELECT car, driver, count(*) AS laps, min(duration_s) AS best_lap_s, avg(duration_s) AS mean_lap_s,
       avg(energy_out_wh - energy_in_wh) AS energy_wh, avg(power_mean_w) AS power_mean_w
FROM laps
WHERE counts AND ($car = '' OR car = $car)
GROUP BY car, driver
ORDER BY car, mean_lap_s, driver
