"""Readings of data values, and values that hold on."""

from __future__ import annotations

import math
from datetime import UTC, datetime

import pytest
from asyncua import ua

from api.bridges.opcua.readings import Holding, Quality, Reading, reading_of

MOMENT = datetime(2026, 11, 21, 9, 20, 0, 250_000, tzinfo=UTC)
GOOD, UNCERTAIN, BAD = Quality.GOOD, Quality.UNCERTAIN, Quality.BAD


@pytest.mark.parametrize(
    ("value", "status", "expected"),
    [
        (ua.Variant(812.5), ua.StatusCodes.Good, (812.5, GOOD)),
        (ua.Variant(Value=True), ua.StatusCodes.GoodLocalOverride, (1.0, GOOD)),
        (ua.Variant(3, ua.VariantType.UInt16), ua.StatusCodes.UncertainLastUsableValue, (3.0, UNCERTAIN)),
        (ua.Variant(812.5), ua.StatusCodes.BadSensorFailure, (812.5, BAD)),
        (ua.Variant(math.nan), ua.StatusCodes.Good, (None, BAD)),
        (ua.Variant(math.inf), ua.StatusCodes.Good, (None, BAD)),
        (ua.Variant("812.5"), ua.StatusCodes.Good, (None, BAD)),
        (ua.Variant([1.0, 2.0]), ua.StatusCodes.Good, (None, BAD)),
        (ua.Variant(None), ua.StatusCodes.BadNoData, (None, BAD)),
    ],
)
def test_what_a_data_value_says(value, status, expected):
    told = reading_of("PT", ua.DataValue(value, ua.StatusCode(status), MOMENT))
    assert told == Reading("PT", MOMENT.timestamp(), *expected)


def test_the_time_is_the_source_s_else_the_server_s():
    assert reading_of("PT", ua.DataValue(ua.Variant(1.0), ServerTimestamp=MOMENT)).time == MOMENT.timestamp()
    before = datetime.now(UTC).timestamp()
    assert reading_of("PT", ua.DataValue(ua.Variant(1.0))).time >= before


def told(holding, *readings):
    """What is pushed, and what holds on beside it."""
    pushed = [Reading(tag, time, value, quality) for tag, time, value, quality in readings]
    return [reading[:3] for reading in holding.push(pushed)[len(pushed) :]]


def test_a_value_that_is_not_told_anew_holds_on_in_seconds_of_others():
    holding = Holding()
    assert told(holding, ("V", 10.1, 1.0, GOOD), ("P", 10.2, 50.0, GOOD), ("P", 11.2, 51.0, GOOD)) == []
    assert told(holding, ("P", 12.2, 52.0, GOOD), ("P", 13.2, 53.0, GOOD)) == [("V", 11.0, 1.0)]
    assert told(holding, ("V", 14.3, 0.0, GOOD), ("P", 15.2, 55.0, GOOD)) == [("V", 12.0, 1.0), ("V", 13.0, 1.0)]
    found = told(holding, ("P", 20.0, 60.0, GOOD), ("P", 22.0, 62.0, GOOD))
    assert found == [("P", 14.0, 53.0), ("V", 15.0, 0.0), ("V", 20.0, 0.0)]  # nothing from 16 to 19


def test_what_was_bad_does_not_hold_on_and_what_was_uncertain_stays_so():
    holding = Holding()
    told(holding, ("A", 1.0, 1.0, UNCERTAIN), ("B", 1.0, 2.0, BAD), ("P", 1.0, 0.0, GOOD))
    held = holding.push([Reading("P", 2.0, 0.0, GOOD), Reading("P", 4.0, 0.0, GOOD)])[2:]
    assert held == [Reading("A", 2.0, 1.0, UNCERTAIN)]


def test_ten_readings_a_second_are_not_held():
    holding = Holding()
    found = [
        held
        for tick in range(200)
        for held in told(holding, ("A", 5.0 + tick / 10, 1.0, GOOD), ("B", 5.05 + tick / 10, 2.0, GOOD))
    ]
    assert found == []
