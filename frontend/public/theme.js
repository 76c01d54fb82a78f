// Before anything is painted: the theme of the last visit, so that a light page does not flash dark.
{
  const kept = localStorage.getItem('voltwall.theme');
  const preferred = matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark';
  document.documentElement.dataset.theme = ['dark', 'light', 'sun'].includes(kept) ? kept : preferred;
}
