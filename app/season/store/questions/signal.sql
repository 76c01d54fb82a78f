-- Any signal of all sessions: lowest, mean and highest value of each minute.
-- $signal = v[36]: name of the signal, as in an export
SELECT session, date_trunc('minute', time) AS minute,
       min("$signal") AS lowest, avg("$signal") AS mean, max("$signal") AS highest
FROM samples
GROUP BY session, minute
ORDER BY session, minute
