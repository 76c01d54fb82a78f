-- Lowest voltage of each cell in each lap.
SELECT session, lap, pack, cell_in_pack, min(voltage_min_v) AS voltage_min_v
FROM cells
WHERE lap > 0
GROUP BY session, lap, pack, cell_in_pack
ORDER BY session, lap, pack, cell_in_pack
