"""Arrays as bytes and back, without pickles: what snapshots are kept in."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Mapping

import numpy as np

from station.errors import InputError

_HEAD = struct.Struct("<4sII")
_MAGIC = b"HRA1"
_ZIPPED = b"PK"
"""How archives begin that were written before: files of the .npz format, which take ten times as long to write."""


def pack(arrays: Mapping[str, np.ndarray]) -> bytes:
    """The arrays as an archive: the same bytes for the same arrays.

    It is a checksum, the names, types and shapes as JSON, and the bytes of the arrays one behind the other.

    Raises
    ------
    TypeError
        if an array holds objects.
    """
    index, parts = [], []
    for name, each in arrays.items():
        if each.dtype.hasobject:
            raise TypeError(f"{name} must hold no objects, which have no bytes")
        index.append([name, each.dtype.str, each.shape])
        parts.append(each.tobytes())
    about = json.dumps(index).encode()
    body = b"".join((struct.pack("<I", len(about)), about, *parts))
    return _HEAD.pack(_MAGIC, zlib.crc32(body), len(body)) + body


def unpack(archive: bytes) -> dict[str, np.ndarray]:
    """The arrays of an archive, whose checksum is compared first.

    Raises
    ------
    InputError
        if it is none.
    """
    try:
        return _unzipped(archive) if archive[:2] == _ZIPPED else _unpacked(archive)
    # of archives that are damaged zipfile says too that they are encrypted, or packed as it cannot read
    except (
        ValueError,
        TypeError,
        KeyError,
        EOFError,
        OSError,
        RuntimeError,
        zipfile.BadZipFile,
        struct.error,
    ) as error:
        raise InputError("snapshot", [("", f"cannot be read: {error!s:.200}")]) from None


def _unpacked(archive: bytes) -> dict[str, np.ndarray]:
    magic, checksum, length = _HEAD.unpack_from(archive)
    body = archive[_HEAD.size :]
    if magic != _MAGIC or length != len(body) or checksum != zlib.crc32(body):
        raise ValueError("it is no archive of arrays, or damaged")
    (about,) = struct.unpack_from("<I", body)
    begin, found = 4 + about, {}
    for name, kind, shape in json.loads(body[4:begin]):
        found[name] = np.ndarray(shape, kind, body, begin).copy()
        begin += found[name].nbytes
    return found


def _unzipped(archive: bytes) -> dict[str, np.ndarray]:
    with zipfile.ZipFile(io.BytesIO(archive)) as files:
        return {
            name.removesuffix(".npy"): np.lib.format.read_array(io.BytesIO(files.read(name)), allow_pickle=False)
            for name in files.namelist()
        }


def arrays_under(arrays: Mapping[str, np.ndarray], head: str) -> dict[str, np.ndarray]:
    """The arrays whose names begin so, without that beginning."""
    return {name.removeprefix(head): each for name, each in arrays.items() if name.startswith(head)}


def refuse_other_shapes(arrays: Mapping[str, np.ndarray], wanted: Mapping[str, np.ndarray]) -> None:
    """Refuse arrays that are missing, or have another shape or type than those wanted; kernels check no index.

    Raises
    ------
    InputError
        naming the first of them.
    """
    for name, like in wanted.items():
        array = arrays.get(name)
        if array is None or (array.shape, array.dtype) != (like.shape, like.dtype):
            raise InputError("snapshot", [(name, "cannot be read: it is none that a run could have written")])
