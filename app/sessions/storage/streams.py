"""A column of integers, or the bits of floating-point numbers, as few bytes: differences, zigzag, byte planes, zlib.

A stream is either one item (every sample equals it) or the compressed planes. A block is many streams behind each
other with the offset at which each one ends.
"""

import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

MOST_SAMPLES = 1 << 22  # samples of a chunk, about a minute
KINDS = frozenset(("|i1", "|u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8", "<f8"))  # as numpy calls them
_LEVEL = 1  # higher levels take several times the time for a few percent
IntArray = NDArray[np.signedinteger | np.unsignedinteger]
CountArray = NDArray[np.signedinteger | np.unsignedinteger | np.float64]


def pack_block(values: CountArray) -> tuple[bytes, bytes]:
    """Return (ends, data) of a (samples, elements) array of little-endian numbers, at least one sample."""
    n_samples, n_elements = values.shape
    size = values.dtype.itemsize
    planes = _zigzag(values).T.copy().view(np.uint8).reshape(n_elements, n_samples, size).transpose(0, 2, 1).copy()
    constant = (values == values[0]).all(axis=0)
    streams = [
        values[0, i].tobytes() if constant[i] else zlib.compress(planes[i].data, _LEVEL) for i in range(n_elements)
    ]
    ends = np.cumsum([len(stream) for stream in streams], dtype="<u4")
    return ends.tobytes(), b"".join(streams)


def unpack_streams(streams: Sequence[bytes], dtype: str, n_samples: int) -> CountArray:
    """Return the (samples, streams) values of some streams of a block.

    Raises:
        ValueError, zlib.error: a stream is damaged.
    """
    if dtype not in KINDS:
        raise ValueError(f"columns of type {dtype!r}")
    kind = np.dtype(dtype)
    if not 0 <= n_samples <= MOST_SAMPLES:
        raise ValueError(f"{n_samples} samples in a chunk, at most {MOST_SAMPLES}")
    values = np.empty((len(streams), n_samples), kind)
    varying = [i for i, stream in enumerate(streams) if len(stream) != kind.itemsize]
    for i, stream in enumerate(streams):
        if len(stream) == kind.itemsize:
            values[i] = np.frombuffer(stream, kind)[0]
    if varying:
        planes = b"".join([_unpacked(streams[i], kind.itemsize * n_samples) for i in varying])
        whole = np.frombuffer(planes, np.uint8).reshape(len(varying), kind.itemsize, n_samples)
        unsigned = whole.transpose(0, 2, 1).copy().view(f"<u{kind.itemsize}")[:, :, 0]
        values[varying] = np.cumsum(_unzigzag(unsigned), axis=1, dtype=unsigned.dtype).view(kind)
    return values.T


def _unpacked(stream: bytes, size: int) -> bytes:
    """What a stream holds, which is `size` bytes; one that would be larger is not unpacked any further."""
    inflater = zlib.decompressobj()
    body = inflater.decompress(stream, size + 1)
    if len(body) != size:
        raise ValueError(f"a column holds other than {size} bytes")
    inflater.decompress(b"", 1)  # its checksum is behind the last byte
    if not inflater.eof:
        raise ValueError("a column is cut off")
    return body


def stream_ranges(ends: bytes, elements: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Return where in a block's data the streams of some elements start and end."""
    table = np.frombuffer(ends, "<u4")
    starts = np.append(0, table)
    return list(zip(starts[elements].tolist(), table[elements].tolist(), strict=True))


def _zigzag(values: CountArray) -> IntArray:
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
