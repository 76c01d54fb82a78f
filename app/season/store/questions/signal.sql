-- Any signal of all sessions: lowest, mean and highest value of each minute.
-- $signal = v[36]: name of the signal, as in an export
-- $car = : name of the car; empty: of each
SELECT car, session, date_trunc('minute', time) AS minute,
       min("$signal") AS lowest, avg("$signal") AS mean, max("$signal") AS highest
FROM samples
WHERE $car = '' OR car = $car
GROUP BY car, session, minute
ORDER BY car, session, minute
