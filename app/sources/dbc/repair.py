"""DBC files as they are found: lines that cantools refuses are repaired or left out, each with a warning."""

import math
import re
from collections.abc import Iterator

from app.sources.dbc.definitions import Oddity
from app.words import Message

_PSEUDO_IDS = (0xC0000000, 0x80000000)  # Vector's message of signals without a message, and the empty 29-bit id
_MOST_29_BITS = 0x1FFFFFFF
# What an expression took it never gives back (`++`, `*+`): a line costs time in proportion to its length.
_MESSAGE = re.compile(r"\s*+BO_\s++(\d{1,10}+)\s++([^\s:]++)\s*+:?\s*+(\d{1,10}+)\s*+(\S*+)")
_SIGNAL = re.compile(
    r"\s*+SG_\s++(?P<name>[^\s:]++)\s*+(?:(?P<mux>M|m\d++M?)\s*+)?:\s*+(?P<start>\d{1,5}+)\s*+\|"
    r"\s*+(?P<length>\d{1,5}+)\s*+@\s*+(?P<order>[01])\s*+(?P<sign>[+-])"
    r"\s*+\(\s*+(?P<factor>[^,\s]++)\s*+,\s*+(?P<offset>[^)\s]++)\s*+\)"
    r"\s*+(?:\[\s*+(?P<low>[^|\s]*+)\s*+\|\s*+(?P<high>[^\]\s]*+)\s*+\]\s*+)?\"?(?P<unit>[^\"]*+)"
)
_SELECTS = re.compile(r"mux|multiplex|page|index|group|(?:^|_)id(?:$|_)|select", re.IGNORECASE)
_DEFINITION = re.compile(r"\s*+BA_DEF_\s*+(?:(?:BU_|BO_|SG_|EV_)\s*+)?\"([^\"]++)\"")
_ATTRIBUTE = re.compile(r"\s*+(?:BA_|BA_DEF_DEF_)\s++\"([^\"]++)\"")
_WITH_SEMICOLON = ("VAL_ ", "VAL_TABLE_ ", "CM_ ", "BA_ ", "BA_DEF_ ", "BA_DEF_DEF_ ")
_NOTED = re.compile(r"\s*+(VAL_|CM_|BA_|SIG_VALTYPE_|SG_MUL_VAL_|SIG_GROUP_|BO_TX_BU_)\s")
_OF_ID = re.compile(
    r"\s*+(?:VAL_|CM_\s++(?:BO_|SG_)|BA_\s++\"[^\"]*+\"\s++(?:BO_|SG_)|SIG_VALTYPE_|SG_MUL_VAL_|SIG_GROUP_|BO_TX_BU_)"
    r"\s++(\d{1,10}+)\s"
)
_OF_SIGNAL = re.compile(
    r"\s*+(?:VAL_(?=\s++\d++\s++\w++\s++\d)|CM_\s++SG_|BA_\s++\"[^\"]*+\"\s++SG_|SIG_VALTYPE_|SG_MUL_VAL_)"
    r"\s++\d++\s++(\w++)\s"
)


def repaired(text: str, file: str) -> tuple[str, list[Oddity]]:
    """Return a DBC's text that a strict reader takes, and what was odd, by line.

    Left out: statements about pseudo messages, of messages and signals that are not there, and attributes without a
    definition. Repaired: missing spaces, names that are not identifiers, a name given twice.
    """
    worker = _Repair(file, text)
    return worker.run(), worker.oddities


class _Repair:
    def __init__(self, file: str, text: str) -> None:
        self._file = file
        self._lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        self._defined = {match[1] for line in self._lines if (match := _DEFINITION.match(line))}
        self._multiplexers = _unmarked_multiplexers(self._lines)
        self.oddities: list[Oddity] = []
        self._ids: dict[int, dict[str, int]] = {}  # names of a message's signals, as `_unique` counts them
        self._names: dict[str, int] = {}
        self._message: int | None = None
        self._is_dropping = False

    def run(self) -> str:
        return "\n".join(self._repaired())

    def _repaired(self) -> Iterator[str]:
        in_text = False  # a comment goes on over several lines
        is_left_out = False
        for number, line in enumerate(self._lines, 1):
            if in_text:
                in_text = _is_open(line, in_text)
                yield "" if is_left_out else line
                continue
            kept = self._line(number, line)
            is_left_out = kept is None
            in_text = _NOTED.match(line) is not None and _is_open(line, False)
            yield kept if kept is not None else ""

    def _note(self, line: int, what: Message) -> None:
        self.oddities.append(Oddity(self._file, line, what))

    def _line(self, number: int, line: str) -> str | None:
        """A line as it shall be; None = left out."""
        stripped = line.strip()
        if stripped.startswith("BO_ "):
            return self._message_line(number, line)
        if stripped.startswith("SG_ "):
            return self._signal_line(number, line)
        if stripped and not stripped.startswith("BO_TX_BU_"):
            self._message = None
        attribute = _ATTRIBUTE.match(line)
        if attribute and attribute[1] not in self._defined:
            self._note(number, Message("dbc-attribute-undefined", name=attribute[1]))
            return None
        if stripped.startswith(_WITH_SEMICOLON) and not stripped.endswith(";") and self._ends(number):
            line += "" if _is_open(line, False) else " ;"
        if not _NOTED.match(line):
            return line
        return self._noted_line(number, line)

    def _ends(self, number: int) -> bool:
        """Whether the next line begins something else."""
        after = self._lines[number].strip() if number < len(self._lines) else ""
        return not after or re.match(r"[A-Z]+_", after) is not None

    def _noted_line(self, number: int, line: str) -> str | None:
        match = _OF_ID.match(line)
        if match is None:
            return line
        can_id = int(match[1])
        if can_id not in self._ids:
            what = Message("dbc-of-pseudo-message", id=_hex(can_id))
            if can_id not in _PSEUDO_IDS:
                what = Message("dbc-of-unknown-message", id=_hex(can_id))
            self._note(number, what)
            return None
        of_signal = _OF_SIGNAL.match(line)
        if of_signal is not None:
            name = of_signal[1]
            if name not in self._ids[can_id]:
                self._note(number, Message("dbc-of-unknown-signal", name=name, id=_hex(can_id)))
                return None
        return line

    def _message_line(self, number: int, line: str) -> str | None:
        match = _MESSAGE.match(line)
        self._message, self._is_dropping = None, True
        if match is None:
            self._note(number, Message("dbc-line-unreadable", text=line.strip()[:60]))
            return None
        can_id, name, length, sender = int(match[1]), match[2], int(match[3]), match[4]
        if can_id in _PSEUDO_IDS:
            self._note(number, Message("dbc-pseudo-message", name=name))
            return None
        if can_id & ~0x80000000 > _MOST_29_BITS or (not can_id & 0x80000000 and can_id > 0x7FF):
            can_id = (can_id & _MOST_29_BITS) | 0x80000000
            self._note(number, Message("dbc-id-29-bit", name=name, id=_hex(int(match[1]))))
        if can_id in self._ids:
            self._note(number, Message("dbc-id-twice", name=name, id=_hex(can_id)))
            return None
        clean = self._unique(number, name, self._names)
        self._ids[can_id] = {}
        self._message, self._is_dropping = can_id, False
        return f"BO_ {can_id} {clean}: {length} {_identifier(sender) if sender else 'Vector__XXX'}"

    def _signal_line(self, number: int, line: str) -> str | None:
        if self._is_dropping or self._message is None:
            return None
        match = _SIGNAL.match(line)
        if match is None:
            self._note(number, Message("dbc-line-unreadable", text=line.strip()[:60]))
            return None
        if not 1 <= int(match["length"]) <= 64:
            self._note(number, Message("dbc-signal-length", name=match["name"], bits=int(match["length"])))
            return None
        name = self._unique(number, match["name"], self._ids[self._message])
        mux = f" {match['mux']}" if match["mux"] else ""
        if number in self._multiplexers:
            mux = " M"
            self._note(number, Message("dbc-multiplexer-unmarked", name=name))
        numbers = [_number(match[key], default) for key, default in (("factor", 1.0), ("offset", 0.0))]
        low, high = (_number(match[key], 0.0) for key in ("low", "high"))
        if numbers[0] == "0":
            self._note(number, Message("dbc-factor-zero", name=name))
            numbers[0] = "1"
        unit = match["unit"].strip()
        return (
            f" SG_ {name}{mux} : {match['start']}|{match['length']}@{match['order']}{match['sign']}"
            f' ({numbers[0]},{numbers[1]}) [{low}|{high}] "{unit}" Vector__XXX'
        )

    def _unique(self, number: int, name: str, taken: dict[str, int]) -> str:
        """The name as an identifier that is not in `taken`, which counts by name how often it was wanted."""
        clean = _identifier(name)
        if clean != name:
            self._note(number, Message("dbc-name-repaired", name=name, as_name=clean))
        if clean in taken:
            base = clean
            while clean in taken:
                taken[base] += 1
                clean = f"{base}_{taken[base]}"
            self._note(number, Message("dbc-name-twice", name=name, as_name=clean))
        taken[clean] = 1
        return clean


def _unmarked_multiplexers(lines: list[str]) -> set[int]:
    """Lines of signals that must be the multiplexer of their message, because others stand under its values."""
    multiplexers: set[int] = set()
    plain: list[tuple[int, str]] = []
    kinds: set[str] = set()
    for number, line in enumerate([*lines, "BO_ 0"], 1):
        if line.strip().startswith("BO_ "):
            if "m" in kinds and "M" not in kinds and plain:
                named = [n for n, name in plain if _SELECTS.search(name)]
                if len(named) == 1 or len(plain) == 1:
                    multiplexers.add(named[0] if named else plain[0][0])
            plain, kinds = [], set()
        elif signal := _SIGNAL.match(line):
            mux = signal["mux"] or ""
            kinds |= {mux[-1:] if mux.endswith("M") else mux[:1]}
            if not mux:
                plain.append((number, signal["name"]))
    return multiplexers


def _is_open(line: str, is_open: bool) -> bool:
    """Whether a text in quotes goes on in the next line."""
    return (line.replace('\\"', "").count('"') % 2 == 1) != is_open


def _identifier(name: str) -> str:
    clean = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return clean if not clean[:1].isdigit() else f"_{clean}"


def _number(text: str | None, default: float) -> str:
    try:
        value = float((text or "").replace(",", "."))
    except ValueError:
        value = default
    if not math.isfinite(value):
        value = default
    return f"{value:.15g}"


def _hex(can_id: int) -> str:
    return f"0x{can_id:X}"
