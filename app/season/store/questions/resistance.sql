-- Resistance of each cell over the season, with its sigma, temperature and SOC.
-- $car = : name of the car; empty: of each
SELECT start_time, session, car, pack, cell_in_pack,
       1000 * resistance_ohm AS resistance_mohm,
       1000 * resistance_sigma_ohm AS sigma_mohm,
       temperature_mean_degc, soc_mean
FROM cells
WHERE lap = 0 AND resistance_ohm IS NOT NULL AND ($car = '' OR car = $car)
ORDER BY car, pack, cell_in_pack, start_time, session
