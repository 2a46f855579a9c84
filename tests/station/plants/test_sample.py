"""Sample constants: every field of its own type, whatever the order of the fields."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from station.limit_figures import LimitFigures
from station.plants.interface import samples
from station.plants.sample import sample_of
from station.plants.thesis import PlantConstants


class Odd(NamedTuple):
    count: int
    pairs: tuple[tuple[float, int], bool]
    name: str
    share: float


def test_every_number_is_one_of_its_type():
    made = sample_of(Odd, name="odd")
    assert made == Odd(1, ((1.0, 1), True), "odd", 1.0)
    assert [type(value) for value in (made.count, *made.pairs[0], made.pairs[1], made.share)] == [
        int, float, int, bool, float,
    ]  # fmt: skip


def test_constants_within_constants_are_followed():
    class Outer(NamedTuple):
        limits: LimitFigures
        last: int

    made = sample_of(Outer)
    assert made == Outer(LimitFigures(*(1.0,) * len(LimitFigures._fields)), 1)
    assert {type(value) for value in made.limits} == {float}


def test_what_is_given_goes_before():
    assert sample_of(Odd, name="", share=0.0).share == 0.0


def test_samples_have_the_types_of_a_stations_constants():
    from station import load_station

    real = load_station("thesis-fit").constants()
    (sample,) = (each for each in samples() if isinstance(each, PlantConstants))
    assert [type(value) for value in sample] == [type(value) for value in real]
    assert [type(value) for value in sample.limits] == [type(value) for value in real.limits]


def test_a_field_that_is_no_number_must_be_given():
    class Nested(NamedTuple):
        inner: Odd

    with pytest.raises(TypeError, match="a field of type <class 'str'> must be given"):
        sample_of(Nested)
