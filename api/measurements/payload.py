"""A batch as the log keeps it: the same bytes for the same samples, in whatever format they came."""

from __future__ import annotations

import hashlib
import struct

import numpy as np

from station.batches import Batch

_HEAD = struct.Struct("<4sI")
_MAGIC = b"HRM1"
_TYPES = (("tag", "<i2"), ("time", "<f8"), ("value", "<f8"), ("quality", "u1"))


class PayloadError(ValueError):
    """Bytes that `encode_batch` did not write."""


def encode_batch(batch: Batch) -> bytes:
    """The samples of a batch, every figure bit for bit; 19 bytes each."""
    arrays = (np.ascontiguousarray(getattr(batch, name), kind).tobytes() for name, kind in _TYPES)
    return _HEAD.pack(_MAGIC, len(batch)) + b"".join(arrays)


def decode_batch(payload: bytes) -> Batch:
    """The batch that `encode_batch` wrote.

    Raises
    ------
    PayloadError
        if it wrote none such.
    """
    size = sum(np.dtype(kind).itemsize for _, kind in _TYPES)
    magic, count = _HEAD.unpack(payload[: _HEAD.size]) if len(payload) >= _HEAD.size else (b"", 0)
    if magic != _MAGIC or len(payload) != _HEAD.size + count * size:
        raise PayloadError(f"measurements in the log cannot be read: {len(payload)} bytes that begin {payload[:8]!r}")
    arrays, begin = [], _HEAD.size
    for _, kind in _TYPES:
        arrays.append(np.frombuffer(payload, kind, count, begin))
        begin += arrays[-1].nbytes
    return Batch(*arrays)


def digest_of(payload: bytes) -> str:
    """SHA-256 of a payload, in hexadecimal digits."""
    return hashlib.sha256(payload).hexdigest()
