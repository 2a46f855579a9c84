"""Arrays are packed to the same bytes and come back, and damaged archives are refused."""

from __future__ import annotations

import io
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station import InputError
from station.archives import arrays_under, pack, refuse_other_shapes, unpack

ARRAYS = {"a_x": np.arange(6.0).reshape(2, 3), "a_y": np.array("name"), "b": np.zeros(0, np.int64)}
PACKED = pack(ARRAYS)


def test_arrays_come_back_from_bytes_that_are_always_the_same():
    found = unpack(PACKED)
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert (found[name].shape, found[name].dtype) == (array.shape, array.dtype)
        assert found[name].tobytes() == array.tobytes()
    assert pack(found) == PACKED
    assert list(arrays_under(found, "a_")) == ["x", "y"]


def test_archives_as_they_were_written_before_are_read():
    stream = io.BytesIO()
    np.savez(stream, **ARRAYS)
    assert pack(unpack(stream.getvalue())) == PACKED


def test_arrays_that_are_read_can_be_written_to_and_objects_have_no_bytes():
    unpack(PACKED)["a_x"][0, 0] = 7.0
    with pytest.raises(TypeError, match="x must hold no objects"):
        pack({"x": np.array([None])})


@given(st.integers(0, len(PACKED) - 1), st.integers(1, 255))
def test_a_damaged_archive_gives_the_same_arrays_or_is_refused(place, change):
    damaged = bytearray(PACKED)
    damaged[place] ^= change
    with suppress(InputError):
        found = unpack(bytes(damaged))
        assert [array.tobytes() for array in found.values()] == [array.tobytes() for array in ARRAYS.values()]


@given(st.integers(0, len(PACKED) - 1))
def test_a_cut_archive_is_refused(length):
    with pytest.raises(InputError, match="cannot be read"):
        unpack(PACKED[:length])


@pytest.mark.parametrize("like", [np.zeros(3), np.zeros((2, 3), np.int64)])
def test_other_shapes_and_types_are_named(like):
    with pytest.raises(InputError, match="a_x: cannot be read"):
        refuse_other_shapes(ARRAYS, {"b": np.zeros(0, np.int64), "a_x": like})
    with pytest.raises(InputError, match="c: cannot be read"):
        refuse_other_shapes(ARRAYS, {"c": np.zeros(0)})
