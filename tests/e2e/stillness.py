"""What moves on a page by itself: boxes by the browser's own count of layout shifts, and widths of numbers."""

from playwright.sync_api import Page

QUIET_MS = 500  # so long nothing has moved or was fetched: the page has come
WATCH = """() => {
  // of boxes; a figure that gains a digit moves its own text within one
  const apart = (a, b) => Math.abs(a - b) > 0.5;
  const moved = ({node, previousRect: a, currentRect: b}) =>
    node?.nodeType === Node.ELEMENT_NODE && (apart(a.right, b.right) || apart(a.top, b.top));
  const place = ({node}) => node.outerHTML.slice(0, 160);
  window.shifts = [];
  window.stirredAt = performance.now();
  const { fetch } = window;
  window.fetching = 0;
  window.fetch = async (...asked) => {
    window.fetching++;
    try {
      return await fetch(...asked);
    } finally {
      window.fetching--;
      window.stirredAt = performance.now();
    }
  };
  new PerformanceObserver((list) => list.getEntries().forEach((entry) => {
    const places = entry.sources.filter(moved).map(place);
    if (!places.length) return;
    window.shifts.push([entry.value, ...places].join(' '));
    window.stirredAt = performance.now();
  })).observe({ type: 'layout-shift' });
  const widths = new Map();
  window.grown = new Set();
  window.forgetWidths = () => (widths.clear(), window.grown.clear());
  setInterval(() => {
    for (const number of document.querySelectorAll('.number')) {
      const { width } = number.getBoundingClientRect();
      if (apart(widths.get(number) ?? width, width)) {
        const name = number.closest('[data-testid]')?.dataset.testid ?? number.parentElement.parentElement.innerText;
        window.grown.add(`${name}: ${number.innerText}, ${widths.get(number)} to ${width}`);
      }
      widths.set(number, width);
    }
  }, 100);
}"""
QUIET = f"() => !window.fetching && performance.now() > window.stirredAt + {QUIET_MS}"
AGAIN = "() => { window.shifts = []; window.stirredAt = performance.now(); window.forgetWidths(); }"


def watch(page: Page) -> None:
    """Begin to watch a page once it has come and stands still; again, where it is watched already."""
    page.evaluate(AGAIN if page.evaluate("'shifts' in window") else WATCH)
    page.wait_for_function(QUIET)
    page.evaluate(AGAIN)


def moved(page: Page) -> list[str]:
    """Return what moved since `watch`, and which numbers changed their width."""
    return page.evaluate("[...window.shifts, ...window.grown]")
