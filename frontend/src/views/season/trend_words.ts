// What a month changes, in words.

import { signed } from '../../format';
import type { SeasonTrend } from '../../link/types';
import { t } from '../../words/words.svelte';

/** What a month changes, with its band; a band that rounds to nothing is no change, however sure. */
export function monthly(trend: SeasonTrend, decimals: number): string {
  const [pace, low, high] = [trend.per_month, trend.low, trend.high].map((v) => signed(100 * v, decimals));
  const least = 10 ** -decimals / 2;
  if (Math.max(Math.abs(trend.low), Math.abs(trend.high)) * 100 < least) return t('does not change');
  if (!trend.tells_month) return t('too few days to tell what a month changes');
  const words = t('{pace} % a month, 95 %: {low} to {high}', { pace: pace!, low: low!, high: high! });
  return trend.is_sure ? words : `${words} · ${t('not more than chance')}`;
}
