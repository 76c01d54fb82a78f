-- Cells by resistance against the median cell of their session, the worst first.
-- $car = : name of the car; empty: of each
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
