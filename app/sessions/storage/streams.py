"""A column of integers as few bytes: differences, zigzag, byte planes, zlib; and back.

A stream is either one item (every sample equals it) or the compressed planes. A block is many streams behind each
other with the offset at which each one ends.
"""

import zlib

import numpy as np
from numpy.typing import NDArray

_LEVEL = 1  # higher levels take several times the time for a few percent
IntArray = NDArray[np.signedinteger | np.unsignedinteger]


def pack_block(values: IntArray) -> tuple[bytes, bytes]:
    """Return (ends, data) of a (samples, elements) array of little-endian integers, at least one sample."""
    n_samples, n_elements = values.shape
    size = values.dtype.itemsize
    planes = _zigzag(values).T.copy().view(np.uint8).reshape(n_elements, n_samples, size).transpose(0, 2, 1).copy()
    constant = (values == values[0]).all(axis=0)
    streams = [
        values[0, i].tobytes() if constant[i] else zlib.compress(planes[i].data, _LEVEL) for i in range(n_elements)
    ]
    ends = np.cumsum([len(stream) for stream in streams], dtype="<u4")
    return ends.tobytes(), b"".join(streams)


def unpack_stream(stream: bytes, dtype: str, n_samples: int) -> IntArray:
    """Return the (samples,) values of one stream.

    Raises:
        ValueError, zlib.error: the stream is damaged.
    """
    kind = np.dtype(dtype)
    if len(stream) == kind.itemsize:
        return np.full(n_samples, np.frombuffer(stream, kind)[0])
    planes = np.frombuffer(zlib.decompress(stream), np.uint8).reshape(kind.itemsize, n_samples)
    unsigned = planes.T.copy().view(f"<u{kind.itemsize}").reshape(n_samples)
    return np.cumsum(_unzigzag(unsigned), dtype=unsigned.dtype).view(kind)


def unpack_block(ends: bytes, data: bytes, dtype: str, n_samples: int) -> IntArray:
    """Return the (samples, elements) values of a whole block.

    Raises:
        ValueError, zlib.error: a stream is damaged.
    """
    kind = np.dtype(dtype)
    table = np.frombuffer(ends, "<u4").tolist()
    values = np.empty((n_samples, len(table)), kind)
    planes: list[bytes] = []
    varying: list[int] = []
    for element, (start, end) in enumerate(zip([0, *table], table, strict=False)):
        if end - start == kind.itemsize:
            values[:, element] = np.frombuffer(data, kind, 1, start)[0]
        else:
            planes.append(zlib.decompress(data[start:end]))
            varying.append(element)
    if varying:
        whole = np.frombuffer(b"".join(planes), np.uint8).reshape(len(varying), kind.itemsize, n_samples)
        unsigned = whole.transpose(0, 2, 1).copy().view(f"<u{kind.itemsize}")[:, :, 0]
        values[:, varying] = np.cumsum(_unzigzag(unsigned), axis=1, dtype=unsigned.dtype).view(kind).T
    return values


def stream_range(ends: bytes, element: int) -> tuple[int, int]:
    """Return where in a block's data the stream of one element starts and ends."""
    table = np.frombuffer(ends, "<u4")
    return (int(table[element - 1]) if element else 0), int(table[element])


def _zigzag(values: IntArray) -> IntArray:
    """Differences along the samples (first against 0), small ones of either sign as small unsigned numbers."""
    unsigned = values.view(f"<u{values.dtype.itemsize}")
    differences = np.diff(unsigned, axis=0, prepend=np.zeros((1, values.shape[1]), unsigned.dtype))
    one = unsigned.dtype.type(1)
    sign_bit = unsigned.dtype.type(8 * values.dtype.itemsize - 1)
    negative = differences >> sign_bit
    return np.ascontiguousarray((differences << one) ^ (~negative + one))


def _unzigzag(unsigned: IntArray) -> IntArray:
    one = unsigned.dtype.type(1)
    return np.asarray((unsigned >> one) ^ (~(unsigned & one) + one))
