"""Lists by pages: a route takes `limit` and `cursor` and answers `next_cursor`, null on the last page.

A cursor names the last item of a page by what the list is sorted by, so what is added or deleted between two pages
neither repeats an item nor leaves one out.
"""

from collections.abc import Callable, Sequence
from typing import Annotated, TypeVar

from fastapi import Query

T = TypeVar("T")
Place = tuple[int, str]  # what a list is sorted by: a time or a number, then a name
MAX_NUMBER = (1 << 63) - 1
MAX_LIMIT = 5000

CursorQuery = Annotated[
    str | None,
    Query(
        pattern=r"^\d{1,19}(~[A-Za-z0-9._-]{1,200})?$",
        description="`next_cursor` of the page before; none: the first page",
    ),
]
LimitQuery = Annotated[int | None, Query(ge=1, le=MAX_LIMIT, description="most on a page; none: all")]


def place_of(cursor: str) -> Place:
    """Return the place that a cursor names; its pattern was checked."""
    number, _, name = cursor.partition("~")
    return min(int(number), MAX_NUMBER), name


def page_of(
    items: Sequence[T],
    place: Callable[[T], Place],
    limit: int | None,
    cursor: str | None,
    *,
    newest_first: bool = True,
) -> tuple[Sequence[T], str | None]:
    """Return a page of a sorted list, and the cursor of the next, None where there is none.

    Args:
        items: all, or those from the cursor on and one more than the page holds.
        place: of an item; no two are alike.
        limit: most on a page, None = all.
        cursor: where the page before ended, None = the first page.
        newest_first: the list falls; else it rises.
    """
    if cursor is not None:
        end = place_of(cursor)
        items = [item for item in items if (place(item) < end if newest_first else place(item) > end)]
    if limit is None or len(items) <= limit:
        return items, None
    number, name = place(items[limit - 1])
    return items[:limit], f"{number}~{name}" if name else str(number)
