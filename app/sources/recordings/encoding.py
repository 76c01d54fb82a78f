"""In which characters a table was written: UTF-8, UTF-16 with or without its mark, GB 18030 of China, Latin-1.

No file says it. UTF-8 hardly ever fits by chance; what is none of the others is read as Latin-1, which fits anything.
"""

import re

MARKS = (b"\xff\xfe", b"\xfe\xff")  # of UTF-16
_LOOKED_AT = 1 << 12
_CHINESE = re.compile("[电流压时间温度序号步容量能]")  # of the names that a cycler gives its columns


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
