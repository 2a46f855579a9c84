"""Tags that a historian writes only when they change: they hold until then, and nothing is taken for silence."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest
from pydantic import ValidationError

from station.batches import Batch
from station.estimation.assembly import Assembler
from station.frames import frames_of
from station.geometry import VALVES
from station.measurement import Tag, TagMap, samples_of, seem_told_on_change
from tests.station.estimation.hidden import measured, tags, truth
from tests.station.estimation.sensors import LEAKS, SECONDS, STATIONS, read_of, replaced, told

STATES = (*VALVES, "vehicle")
FLOWS = ("flow_compressor", "flow_dispenser")


def _on_change(names):
    """The usual map, some of whose tags are told when they change."""
    given = tags()
    return given.model_copy(
        update={"tags": [each.model_copy(update={"on_change": each.sensor in names}) for each in given.tags]}
    )


def _written(record, names):
    """What is measured, of some sensors only the changes."""
    true = truth(record, SECONDS)
    table = measured(true, 3)
    for name in STATES:  # a change that is lost is another fault
        table = table.set_column(table.column_names.index(name), name, pa.array(true[name]))

    def changes(values):
        last = np.nan
        for second, value in enumerate(values):
            if value == last:
                values[second] = np.nan
            elif np.isfinite(value):
                last = value
        return values

    for name in names:
        table = replaced(table, name, changes)
    return table


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize("names", [VALVES, STATES, (*STATES, *FLOWS)], ids=["valves", "states", "flows too"])
@pytest.mark.parametrize("leaks", [False, True])
def test_they_are_followed_as_if_told_each_second(name, names, leaks, records):
    """A hundred absent valves a day were told."""
    events, why, _ = told(name, _written(records[name, leaks], names), _on_change(names))
    assert [event.name for event in events] == (["leak_medium"] if leaks else [])
    assert all(LEAKS <= event.found_s <= LEAKS + 150 for event in events)
    assert why == []


@pytest.mark.parametrize("name", STATIONS)
@pytest.mark.parametrize(("begin", "seconds"), [(11_700, 120), (11_050, 60), (8000, 3600)])
def test_what_was_told_before_a_gap_holds_no_more(name, begin, seconds, records):
    """Of an outage of the historian false leaks and a tripped compressor were told, or the model was refused."""
    table = _written(records[name, False], STATES)
    time = table["time_s"].to_numpy()
    events, why, _ = told(name, table.filter(pa.array((time < begin) | (time >= begin + seconds))), _on_change(STATES))
    assert [event.name for event in events if not event.name.startswith("absent_")] == []
    assert why == []


def test_a_map_that_does_not_say_it_is_found_out(records):
    table = _written(records["h70-light", False], (*STATES, *FLOWS))
    assert seem_told_on_change(samples_of(table, tags())) == [*FLOWS, *STATES]
    assert seem_told_on_change(samples_of(table, _on_change((*STATES, *FLOWS)))) == []
    assert seem_told_on_change(samples_of(measured(truth(records["h70-light", False], SECONDS), 3), tags())) == []


MAP = TagMap(
    tags=[
        Tag(tag=name, column=name, sensor=name, on_change=name == "inlet_high") for name in (*STATES, "pressure_high")
    ]
)


def _pushed(*rows):
    """Seconds of rows (tag, time, value), together and one by one."""
    parts = Assembler(MAP), Assembler(MAP)
    whole = [parts[0].push(Batch.named(MAP, *zip(*rows, strict=True))), parts[0].close()]
    single = [*(parts[1].push(Batch.named(MAP, *zip(row, strict=True))) for row in rows), parts[1].close()]
    one, other = (np.concatenate([part["inlet_high"] for part in each if part is not None]) for each in (whole, single))
    np.testing.assert_array_equal(one, other)
    return one


def test_the_latest_value_before_a_seconds_end_holds_until_another_or_a_bad_one():
    nothing = np.nan
    found = _pushed(
        ("pressure_high", 0.0, 500.0), ("inlet_high", 1.9, 1.0), ("inlet_high", 2.4, 0.0), ("inlet_high", 4.0, 1.0),
        ("inlet_high", 7.0, nothing), ("inlet_high", 9.0, 0.0), ("pressure_high", 12.0, 500.0),
    )  # fmt: skip
    expected = [nothing, nothing, 0.0, 0.0, 1.0, 1.0, 1.0, nothing, nothing, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_array_equal(found, expected)


def test_an_empty_cell_of_a_record_is_no_sample():
    names = [tag.column for tag in MAP.tags]
    columns = {name: pa.array([0.0, 0.0, 0.0]) for name in names}
    table = pa.table({"time_s": [0.0, 1.0, 2.0], **columns, "inlet_high": pa.array([1.0, None, None])})
    frames = frames_of(samples_of(table, MAP))
    assert frames["inlet_high"].tolist() == [1.0, 1.0, 1.0]
    assert "inlet_high" not in frames.measured
    assert read_of(table, "inlet_high")[0] == 1.0


def test_pressures_change_all_the_time():
    with pytest.raises(ValidationError, match="on_change must be false"):
        Tag(tag="P", column="P", sensor="pressure_high", on_change=True)
