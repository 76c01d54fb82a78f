"""The battery as text: packs where the map draws them, with the numbers of their cells."""

from app.battery.battery import Battery


def drawn(battery: Battery) -> list[str]:
    """Return lines of text, one row of packs each; `>` and `<` tell in which direction cells count."""
    order = battery.drawing.order or tuple(range(battery.n_packs))
    a_row = -(-battery.n_packs // battery.drawing.rows)
    width = max(len(_segment(battery, pack)) for pack in order)
    return [
        "  " + "  ".join(_segment(battery, pack).ljust(width) for pack in order[at : at + a_row]).rstrip()
        for at in range(0, len(order), a_row)
    ]


def _segment(battery: Battery, pack: int) -> str:
    first = battery.starts[pack] + 1
    last = first + battery.segments[pack] - 1
    is_turned = pack in battery.drawing.turned
    cells = f"{last} < {first}" if is_turned else f"{first} > {last}"
    return f"[{pack + 1}: {cells}]"


def sensors_in_words(battery: Battery) -> str:
    """Return which cells the temperature sensors stand for, shortened."""
    if not battery.sensors:
        return "none"
    shown = [f"{i + 1}: {_cells(cells)}" for i, cells in enumerate(battery.sensors[:4])]
    more = "" if battery.n_sensors <= 4 else ", ..."
    return f"{battery.n_sensors}; sensor and its cells {', '.join(shown)}{more}"


def _cells(cells: tuple[int, ...]) -> str:
    numbers = [cell + 1 for cell in cells]
    if len(numbers) > 2 and numbers == list(range(numbers[0], numbers[-1] + 1)):
        return f"{numbers[0]}-{numbers[-1]}"
    return "+".join(map(str, numbers)) or "none"
