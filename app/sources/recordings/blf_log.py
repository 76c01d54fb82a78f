"""CAN frames out of Vector's BLF; a damaged file ends with an error or a note, never without end."""

import struct
import zlib
from collections.abc import Iterator
from importlib import import_module
from typing import Any, BinaryIO

from app.sources.recordings.bad_rows import SHOWN_TEXT, BadRows
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

Frame = tuple[float, int, bytes, str]  # and the bus
_OBJECT = struct.Struct("<4sHHLL")  # signature, header size and version, size, type
_HEADER_SIZE = struct.Struct("<4sL")
_CONTAINER = 10  # type of an object with others in it
_CONTAINER_HEADER = 16  # bytes: compression, size unpacked
_PLAIN, _ZLIB = 0, 2


def blf_frames(file: BinaryIO, bad: BadRows) -> Iterator[Frame]:
    """Yield the data frames of a file; one that breaks off is counted as bad, after the frames before it.

    Raises:
        ValueError: an object has no size: a reader would not get beyond it.
        Exception: python-can cannot read the first frame; it has errors of many kinds.
    """
    _check_sizes(file)
    file.seek(0)
    can = import_module("can")
    good, objects = 0, 0
    try:
        with can.BLFReader(file) as reader:
            objects = reader.object_count
            for message in reader:
                good += 1
                yield from data_frame(message)
    except MemoryError:
        raise
    except Exception as error:  # struct.error, zlib.error, BLFParseError, ...
        if not good:
            raise
        bad.add(None, Message("breaks-off", frames=good, objects=objects, error=str(error)[:SHOWN_TEXT]))


def data_frame(message: Any) -> Iterator[Frame]:
    """Yield the frame of a message of python-can; none of a remote or error frame."""
    if not (message.is_error_frame or message.is_remote_frame):
        extended = CAN_ID_EXTENDED if message.is_extended_id else 0
        bus = "" if message.channel is None else str(message.channel)
        yield float(message.timestamp), message.arbitration_id | extended, bytes(message.data), bus


def first_container(file: BinaryIO) -> bytes:
    """Return the objects of a file's first container; nothing of a file that has none, or is damaged before it."""
    try:
        return next((data for data, _ in _containers(file)), b"")
    except ValueError:
        return b""


def _check_sizes(file: BinaryIO) -> None:
    """Refuse a file with an object that is smaller than its own header; what else is wrong, its reader finds."""
    before = b""
    for data, end in _containers(file):
        before = _check_objects(before + data, end)


def _containers(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Yield what each container holds, unpacked, and where it ends in the file; up to what is no BLF."""
    header = file.read(_HEADER_SIZE.size)
    if len(header) < _HEADER_SIZE.size:
        return
    file.seek(_HEADER_SIZE.unpack(header)[1])
    while len(begin := file.read(_OBJECT.size)) == _OBJECT.size:
        signature, _, _, size, kind = _OBJECT.unpack(begin)
        if signature != b"LOBJ":
            return
        _check_size(size, file.tell() - _OBJECT.size)
        body = file.read(size - _OBJECT.size)
        file.read(size % 4)
        if kind != _CONTAINER or len(body) < _CONTAINER_HEADER:
            continue
        data, method = body[_CONTAINER_HEADER:], int.from_bytes(body[:2], "little")
        if method == _ZLIB:
            try:
                data = zlib.decompressobj().decompress(data)
            except zlib.error:
                return
        if method in (_PLAIN, _ZLIB):
            yield data, file.tell()


def _check_objects(data: bytes, end: int) -> bytes:
    """Check the sizes of the objects of a container that ends at `end`; return what goes on in the next one."""
    at = 0
    while 0 <= (begin := data.find(b"LOBJ", at, at + 8)) <= len(data) - _OBJECT.size:
        size = _OBJECT.unpack_from(data, begin)[3]
        _check_size(size, end)
        if begin + size > len(data):
            return data[begin:]
        at = begin + size
    return data[at:]


def _check_size(size: int, at: int) -> None:
    if size < _OBJECT.size:
        raise ValueError(f"an object of size {size} before byte {at}: the file is damaged")
