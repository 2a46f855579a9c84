"""Faults that a followed station seems to have, and futures that begin with them."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from pydantic import TypeAdapter

from benchmarks.ailing_forecasts import ailing_day, forecasts
from station.estimation.ailments import ailments
from station.estimation.detection import Event
from station.faults.kinds import PlantFault
from station.faults.plant import ValveStuck
from station.geometry import BUFFERS, VALVES

ZERO = 1_795_252_800.0

GIVEN = [
    *({"kind": "leak", "buffer": name, "rate_g_per_s": 0.5} for name in BUFFERS),
    *({"kind": "outlet_leak", "valve": f"outlet_{name}", "rate_g_per_s": 2.0} for name in BUFFERS),
    *({"kind": "valve_stuck", "valve": name, "position": how} for name in VALVES for how in ("open", "closed")),
    {"kind": "line_leak", "rate_g_per_s": 2.0},
    {"kind": "compressor_weak", "loss_percent": 20.0},
    {"kind": "compressor_tripped"},
    {"kind": "dispenser_clogged", "loss_percent": 30.0},
    {"kind": "precooler_weak", "warmer_k": 5.0},
]
FAULTS = [TypeAdapter(PlantFault).validate_python({**each, "begin_s": 40.0}) for each in GIVEN]


def test_every_kind_is_tried():
    assert {type(fault) for fault in FAULTS} == set(get_args(PlantFault))


def _event(name, size, begin=40.0):
    return Event(name, ZERO + begin, ZERO + begin + 60.0, size, "")


def _size(fault):
    if isinstance(fault, ValveStuck):
        return 1.0 if fault.position == "open" else 0.0
    return fault.size[0]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.event}-{getattr(fault, 'position', '')}")
def test_every_fault_of_the_plant_is_had_back_from_its_event(fault):
    assert ailments([_event(fault.event, _size(fault))], {fault.event}, {}, ZERO) == [fault]


def test_the_newest_estimate_is_the_size():
    told = [_event("leak_high", 0.5), _event("compressor_weak", 20.0)]
    estimates = {"leak_high": 0.9, "compressor_factor": 0.6, "leak_low": 3.0}
    weak, leak = ailments(told, {"leak_high", "compressor_weak"}, estimates, ZERO)
    assert leak.rate_g_per_s == 0.9
    assert weak.loss_percent == pytest.approx(40.0)


@pytest.mark.parametrize(
    ("name", "size", "field", "most"),
    [
        *((name, 130.0, "rate_g_per_s", 100.0) for name in ("leak_high", "leak_outlet_low", "leak_line")),
        ("precooler_weak", 70.0, "warmer_k", 60.0), ("dispenser_clogged", 100.0, "loss_percent", 99.0),
    ],
)  # fmt: skip
def test_what_is_larger_than_any_fault_is_as_large_as_one_can_be(name, size, field, most):
    (found,) = ailments([_event(name, size)], {name}, {}, ZERO)
    assert getattr(found, field) == most


def test_only_what_lasts_and_is_of_the_plant_is_had():
    told = [_event("leak_high", 0.5), _event("offset_pressure_low", 4.0), _event("absent_flow_dispenser", 300.0)]
    assert ailments(told, {"offset_pressure_low", "absent_flow_dispenser", "clock_skew_plc"}, {}, ZERO) == []


def test_the_last_word_counts_and_what_has_no_size_left_does_not():
    told = [_event("leak_high", 0.5, 10.0), _event("leak_high", 0.7, 900.0)]
    assert [(each.rate_g_per_s, each.begin_s) for each in ailments(told, {"leak_high"}, {}, ZERO)] == [(0.7, 900.0)]
    assert ailments(told, {"leak_high"}, {"leak_high": -0.01}, ZERO) == []


def test_one_that_began_before_the_run_is_there_from_its_first_second():
    (found,) = ailments([_event("leak_low", 0.5, -30.0)], {"leak_low"}, {}, ZERO)
    assert found.begin_s == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["thesis-fit", "h70-light"])
def test_futures_with_what_was_found_are_those_that_come(preset):
    """As if there were none they are 10 bar off and more."""
    known, record = ailing_day(preset, 4.0, 1, {"kind": "compressor_tripped"})
    pairs = list(forecasts(known, record, 1, 4))
    lasting, mended = (np.median(np.abs([each[k].errors for each in pairs])) for k in range(2))
    assert lasting < 1.0
    assert mended > 10.0
    assert [round(each.served[0]) for each, _ in pairs] == [each.served[1] for each, _ in pairs]
