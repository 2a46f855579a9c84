"""Arrays as bytes and back: the .npz archives, without pickles, that snapshots are kept in."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from station.errors import InputError


def pack(arrays: Mapping[str, np.ndarray]) -> bytes:
    """The arrays as an archive: the same bytes for the same arrays."""
    given: dict[str, Any] = dict(arrays)
    stream = io.BytesIO()
    np.savez(stream, **given)
    return stream.getvalue()


def unpack(archive: bytes) -> dict[str, np.ndarray]:
    """The arrays of an archive, whose checksums are compared first.

    Raises
    ------
    InputError
        if it is none.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(archive)) as files:
            return {
                name.removesuffix(".npy"): np.lib.format.read_array(io.BytesIO(files.read(name)), allow_pickle=False)
                for name in files.namelist()
            }
    # of archives that are damaged zipfile says too that they are encrypted, or packed as it cannot read
    except (ValueError, TypeError, KeyError, EOFError, OSError, RuntimeError, zipfile.BadZipFile) as error:
        raise InputError("snapshot", [("", f"cannot be read: {error!s:.200}")]) from None


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
