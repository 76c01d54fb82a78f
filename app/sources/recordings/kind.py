"""The kind of a recording, by its content, and the encoding of its text; its name decides last."""

import gzip
import re
import zipfile
import zlib
from codecs import BOM_UTF8
from pathlib import Path

from app.sources.recordings.line_logs import CANDUMP_LINE, CANDUMP_WITHOUT_TIME, CRTD_LINE, SAVVYCAN_HEADER

CAN_LOGS = ("candump", "asc", "trc", "blf", "savvycan", "crtd", "mf4")
ENDINGS = {".log": "candump", ".asc": "asc", ".trc": "trc", ".blf": "blf", ".crtd": "crtd", ".mf4": "mf4"}
NUL_RUN = re.compile(rb"\0{16,}")
_READ = 1 << 16
_LINES = 200
_MAGIC = (
    (b"PAR1", "parquet"),
    (b"LOGG", "blf"),
    (b"MDF ", "mf4"),
    (b"UnFinMF ", "mf4"),
    (b"\x89MCAP0\r\n", "mcap"),
    (b"SQLite format 3\0", "session"),
    (b"BIO-LOGIC MODULAR FILE", "mpr"),
    (b"NEWARE", "nda"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "xls"),
    (b"\0\1\0\0Standard", "res"),
    (b"\x40\0\0\0\0\0\0\0", "ld"),
    (b"%PDF-", "unknown"),
)
_ASC = re.compile(r"^\s*(date\s+\w{3}\s|base\s+(hex|dec)\b|begin\s+triggerblock)", re.IGNORECASE | re.MULTILINE)
_TRC = re.compile(r"^;\$FILEVERSION=|^;\s+(Message|Nr)\s|^[^\S\n]*\d+\)\s+\d+\.\d+\s+(Rx|Tx|Warng|\d)", re.MULTILINE)


def kind_of(path: Path) -> str:
    """Return what a file is: one of `CAN_LOGS`, "table", "parquet", "xlsx", "ndax", "zip", "unknown" for a binary, ...

    A file that cannot be opened is what its name says.
    """
    by_name = ENDINGS.get(path.suffix.lower(), "table")
    try:
        with path.open("rb") as file:
            raw = file.read(_READ)
        if raw[:2] == b"\x1f\x8b":
            with gzip.open(path) as packed:
                raw = packed.read(_READ)
    except (OSError, EOFError, zlib.error):
        return by_name
    by_magic = next((kind for magic, kind in _MAGIC if raw.startswith(magic)), None)
    if by_magic is not None:
        return by_magic
    if raw.startswith(b"PK\3\4"):
        return _kind_of_zip(path)
    if b"\0" in without_nul_runs(raw) and not wide_encoding(raw):
        return by_name if by_name in ("blf", "mf4") else "unknown"
    return _kind_of_text(raw) or by_name


def is_can_log(path: Path) -> bool:
    """Return whether a file holds CAN frames."""
    kind = kind_of(path)
    if kind != "mf4":
        return kind in CAN_LOGS
    with path.open("rb") as file:
        return any(b"CAN_DataFrame" in piece for piece in iter(lambda: file.read(1 << 22), b""))


def names_in_zip(path: Path) -> list[str]:
    """Return the files in a zip archive, none of one that cannot be read."""
    try:
        with zipfile.ZipFile(path) as packed:
            return [entry.filename for entry in packed.infolist() if not entry.is_dir()]
    except (OSError, zipfile.BadZipFile):
        return []


def _kind_of_zip(path: Path) -> str:
    names = names_in_zip(path)
    if any(name.startswith("xl/") for name in names):
        return "xlsx"
    if any(name.endswith(".ndc") for name in names):
        return "ndax"
    return "zip" if names else "unknown"


def _kind_of_text(raw: bytes) -> str | None:
    text = raw.removeprefix(BOM_UTF8).decode(wide_encoding(raw) or "latin-1", "replace")
    lines = [line for line in text.splitlines()[:_LINES] if line.strip()]
    if any(SAVVYCAN_HEADER.match(line) for line in lines[:5]):
        return "savvycan"
    for kind, pattern in (("candump", CANDUMP_LINE), ("crtd", CRTD_LINE)):
        if sum(pattern.match(line) is not None for line in lines) > 0.4 * len(lines):
            return kind
    if lines and sum(CANDUMP_WITHOUT_TIME.match(line) is not None for line in lines) > 0.4 * len(lines):
        return "candump-no-time"
    if _TRC.search(text):
        return "trc"
    return "asc" if _ASC.search("\n".join(lines[:5])) else None


def without_nul_runs(raw: bytes) -> bytes:
    """Return a file's bytes with a line's end for each run of zeros: there the power went away."""
    return NUL_RUN.sub(b"\n", raw)


MARKS = (b"\xff\xfe", b"\xfe\xff")  # byte-order marks of UTF-16
_LOOKED_AT = 1 << 12
_CHINESE = re.compile("[电流压时间温度序号步容量能]")  # characters of a cycler's Chinese column names


def text_of(raw: bytes) -> str:
    """Return a file's text; a zero byte stays in it where it is none."""
    wide = wide_encoding(raw)
    for encoding in (wide,) if wide else ("utf-8-sig", "gb18030"):
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if encoding != "gb18030" or _CHINESE.search(text):
            return text
    return raw.decode("latin-1")


def wide_encoding(raw: bytes) -> str | None:
    """Return which UTF-16 a file is in, None where it is in none; without a mark every other byte of it is zero."""
    if raw[:2] in MARKS:
        return "utf-16"
    begin = raw[: min(_LOOKED_AT, len(raw) // 2 * 2)]
    if not begin:
        return None
    zeros = begin[0::2].count(0), begin[1::2].count(0)
    for encoding, of_letters, of_zeros in (("utf-16-le", *zeros), ("utf-16-be", *zeros[::-1])):
        if not of_letters and of_zeros > 0.4 * len(begin):
            return encoding
    return None
