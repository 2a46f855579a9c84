"""The figures of any window of a twin's record are independent sums over that record, whatever plant and cut."""

from __future__ import annotations

import random
import time

import numpy as np
import pytest

from api.http.timeseries import Selection
from api.store.database import Database
from api.twins import figures as twin_figures
from api.twins.figure_schemas import WindowFigures
from api.twins.figures import figures, table_of
from api.twins.minutes import thin
from api.twins.record_parts import parts
from api.twins.replay import replay_request
from api.twins.schemas import TwinOrder, TwinRequest
from api.twins.window_tally import WINDOW_FLOATS, WINDOW_UNITS
from api.twins.windows import HOUR_S, By, Shifts, Window, windows_of
from controllers import create_from
from station import InputError, Limit, Status, load_station, parse_scenario, simulate
from station.geometry import BUFFERS, VALVES
from station.metrics import state_of_charge
from station.shifts import Shifts as StationShifts
from tests.api.measured import batches, measured
from tests.api.reopened import opening
from tests.api.test_day_bill import CHANGING, METERED, POWERED
from tests.api.test_measured_twins import _send, _taken
from tests.waiting import wait_until

SHIFT = 8 * HOUR_S
PRICE_OF_STOCK, PRICE_OF_HYDROGEN, DEMAND = 3.0, 12.0, 12.0
MONTH = 365 * 86_400 / 12
STATIONS = {"thesis": POWERED, "real-gas": METERED}


def scenario_at(station):
    tariff = {
        "energy": CHANGING, "demand_eur_per_kw_month": DEMAND, "stock_eur_per_kg": PRICE_OF_STOCK,
        "hydrogen_eur_per_kg": PRICE_OF_HYDROGEN,
    }  # fmt: skip
    arrivals = {"kind": "uniform", "count": 4, "period_s": 500.0}
    document = {"name": "paid", "station": {**station, "tariff": tariff}, "arrivals": arrivals, "idle_period_s": 1}
    return parse_scenario(document)


@pytest.fixture(scope="module", params=STATIONS)
def ended(request, tmp_path_factory):
    """A server whose twin `t` has run to its end, and the record of the same run."""
    scenario = scenario_at(STATIONS[request.param])
    store = Database(f"sqlite:///{tmp_path_factory.mktemp('figures') / 'hrs.db'}")
    store.migrate()
    with opening(store, checkpoint_s=0.1) as make:
        twins = make()
        twins.start(TwinRequest(id="t", scenario=scenario, controller="logic", speed="max", at_end="stop"))
        wait_until(lambda: twins.state("t").state == "finished")
        wait_until(lambda: twins._store.get("t").samples == twins.samples("t"))
        yield twins, simulate(scenario, create_from("logic")), make
    store.close()


def asked(twins, first, end, by=By.WINDOW, shift=SHIFT, twin="t"):
    return figures(twins, twin, first, end, by, Shifts(shift, 0))


def energies(record, first, end):
    """What compressors and precooler took in each second [kWh], from the meters of the record or the powers."""
    if "energy_compressor" in record.columns:
        return [np.diff(record[f"energy_{name}"][first : end + 1]) for name in ("compressor", "precooler")]
    powers = record.scenario.station.powers
    inlets, outlets = (sum(record[f"{side}_{name}"].astype(int) for name in BUFFERS) for side in ("inlet", "outlet"))
    return [powers[0] * inlets[first:end] / 3600, powers[1] * (outlets[first:end] > 0) / 3600]


def price_of(second):
    """Price of energy taken evenly in a second, by the part of it that lies in each period [EUR/kWh]."""
    begin, total = second % 86_400, 0.0
    for period in CHANGING:
        overlap = min(begin + 1, 3600 * period["to_h"]) - max(begin, 3600 * period["from_h"])
        total += max(0.0, overlap) * period["eur_per_kwh"]
    return total


def by_hand(record, first, end):
    """The figures of the seconds from `first` to `end`, each a plain sum of its own over the record."""
    vehicles, seconds = record.vehicles, range(first, end)
    connected = (vehicles["connected"] >= first) & (vehicles["connected"] < end)
    left = (vehicles["finished"] > first) & (vehicles["finished"] <= end)
    waits = (vehicles["connected"] - vehicles["arrival"])[connected]
    charge = state_of_charge({name: column[left] for name, column in vehicles.items()}, record.scenario.station.plant)
    compressor, precooler = energies(record, first, end)
    spent = compressor + precooler
    quarters = {second // 900: 0.0 for second in seconds}
    for second, energy in zip(seconds, spent, strict=True):
        quarters[second // 900] += energy
    peak = 4 * max(quarters.values())
    kilograms = sum(record["flow_dispenser"][second] for second in seconds) / 1000
    missing = [max(0.0, record[f"mass_{name}"][first] - record[f"mass_{name}"][end]) / 1000 for name in BUFFERS]
    energy_eur = sum(price_of(second) * energy for second, energy in zip(seconds, spent, strict=True))
    demand, stock = peak * DEMAND * (end - first) / MONTH, PRICE_OF_STOCK * sum(missing)
    total = energy_eur + demand + stock
    inlets = [sum(int(record[valve][second]) for valve in VALVES[:3]) for second in range(-1, end) if second >= 0]
    inlets = [0, *inlets]  # of the second before each
    there = [record["vehicle"][second] >= 0 for second in seconds]
    starved = [here and record["flow_dispenser"][second] <= 0 for here, second in zip(there, seconds, strict=True)]
    refused = np.concatenate([record[f"refused_{valve}"][first:end] for valve in VALVES])
    return {
        "from_s": first, "to_s": end, "whole_s": end - first, "unread_s": 0,
        "vehicles_arrived": int(((np.ceil(vehicles["arrival"]) >= first) & (np.ceil(vehicles["arrival"]) < end)).sum()),
        "vehicles_connected": int(connected.sum()), "vehicles_served": int(left.sum()), "vehicles_incomplete": 0,
        "vehicles_waiting": int(record["queue_length"][end - 1]),
        "wait_mean_s": waits.mean() if waits.size else None,
        "wait_p95_s": np.quantile(waits, 0.95) if waits.size else None,
        "wait_max_s": waits.max() if waits.size else None,
        "state_of_charge_mean": charge.mean() if left.any() else None,
        "state_of_charge_min": charge.min() if left.any() else None,
        "delivered_kg": kilograms, "compressor_s": sum(inlets[first + 1 :]),
        "dispensing_s": sum(any(record[valve][second] for valve in VALVES[3:]) for second in seconds),
        "occupied_s": sum(there), "utilisation": sum(there) / (end - first),
        "availability": 1 - sum(starved) / (end - first),
        "energy_kwh": spent.sum(), "compressor_kwh": compressor.sum(), "precooler_kwh": precooler.sum(),
        "kwh_per_kg": spent.sum() / kilograms if kilograms else None,
        "energy_eur": energy_eur, "demand_eur": demand, "stock_eur": stock, "total_eur": total,
        "eur_per_kg": total / kilograms if kilograms else None, "peak_kw": peak,
        "revenue_eur": PRICE_OF_HYDROGEN * kilograms, "margin_eur": PRICE_OF_HYDROGEN * kilograms - total,
        "compressor_starts": sum(max(0, inlets[k + 1] - inlets[k]) for k in seconds),
        "refused_valves": int((refused > 0).sum()),
        "refused": {limit.name.lower(): int((refused == limit).sum()) for limit in Limit if limit},
        "deadlines_missed": 0,
        "liveness_s": int((record["decision_status"][first:end] == Status.LIVENESS).sum()),
    }  # fmt: skip


def near(value):
    """Equal to a figure to 1e-9; the figure itself where it is none, or one of many."""
    return pytest.approx(value, rel=1e-9, abs=1e-12) if isinstance(value, int | float) else value


def windows(last):
    """The whole record, stretches at its edges, single seconds, and some drawn ones."""
    rng = random.Random(27)
    drawn = [sorted(rng.sample(range(last + 1), 2)) for _ in range(12)]
    return [(0, last), (0, 1), (last - 1, last), (540, 541), (899, 901), *drawn]


def test_any_window_is_an_independent_sum_over_the_record(ended):
    twins, record, _ = ended
    last = int(record["time"][-1])
    assert asked(twins, None, None)[0]["to_s"] == last
    for first, end in windows(last):
        (found,) = asked(twins, first, end)
        expected = by_hand(record, first, end)
        assert set(found) == set(expected) == set(WindowFigures.model_fields)
        for name, value in expected.items():
            assert found[name] == near(value), (name, first, end)
    assert by_hand(record, 0, last)["delivered_kg"] > 5
    assert by_hand(record, 0, last)["vehicles_served"] > 2


def test_parts_of_any_size_make_the_same_figures(ended, monkeypatch):
    twins, record, _ = ended
    last = int(record["time"][-1])
    (whole,) = asked(twins, 7, last - 3)
    monkeypatch.setattr("api.twins.record_parts.PART_S", 97)
    monkeypatch.setattr(twin_figures, "EVENTS_AT_ONCE", 2)
    (again,) = asked(twins, 7, last - 3)
    assert {name: value for name, value in again.items() if value != whole[name]} == {}
    assert sum(len(part.time) for part in parts(twins, "t", 7, last)) == last - 6


def test_windows_of_a_cut_add_up_and_are_those_asked_for_alone(ended):
    twins, record, _ = ended
    last = int(record["time"][-1])
    (whole,) = asked(twins, 100, last)
    cut = asked(twins, 100, last, By.SHIFT, 700)
    assert [(each["from_s"], each["to_s"]) for each in cut] == [
        (max(100, begin), min(begin + 700, last)) for begin in range(0, last, 700)
    ]
    for name in (
        "vehicles_arrived",
        "vehicles_served",
        "compressor_s",
        "compressor_starts",
        "occupied_s",
        "refused_valves",
    ):
        assert sum(each[name] for each in cut) == whole[name], name
    for name in ("delivered_kg", "energy_kwh", "compressor_kwh", "energy_eur", "revenue_eur"):
        assert sum(each[name] for each in cut) == pytest.approx(whole[name], rel=1e-9), name
    for each in cut:
        assert asked(twins, each["from_s"], each["to_s"]) == [each]


def test_a_twin_that_has_ended_is_told_from_what_is_stored(ended):
    twins, record, make = ended
    again = make()
    last = int(record["time"][-1])
    for first, end in windows(last)[:8]:
        assert asked(again, first, end) == asked(twins, first, end)
    assert again.days("t") == twins.days("t") != []


def test_a_replay_has_the_figures_of_its_seconds(ended):
    twins, _, _ = ended
    order = TwinOrder.model_validate(
        {"id": "r", "source": "replay", "of": "t", "speed": "max", "from_s": 200, "to_s": 600}
    )
    twins.start(replay_request(twins, order))
    wait_until(lambda: twins.state("r").state == "finished")
    assert asked(twins, 250, 550, twin="r") == asked(twins, 250, 550)
    (all_of_it,) = asked(twins, None, None, twin="r")
    assert (all_of_it["from_s"], all_of_it["to_s"]) == (200, 601)
    assert all_of_it["compressor_starts"] is None, "what ran before is not known"
    assert all_of_it["total_eur"] is None, "nor what is in the buffers behind it"
    twins.remove("r")


def test_days_of_a_twin_are_the_figures_of_their_windows(opened, monkeypatch):
    monkeypatch.setattr("api.twins.days.DAY_S", 900)
    monkeypatch.setattr("api.twins.windows.DAY_S", 900)
    twins = opened()
    scenario = scenario_at(METERED)
    twins.start(TwinRequest(id="t", scenario=scenario, controller="logic", speed="max", at_end="repeat"))
    wait_until(lambda: len(twins.days("t")) > 2)
    twins.stop("t")
    days, found = twins.days("t"), asked(twins, None, None, By.DAY)
    assert [(day["from_s"], day["to_s"]) for day in days] == [(each["from_s"], each["to_s"]) for each in found]
    for day, each in zip(days, found, strict=True):
        assert {name: each[name] for name in day if name != "day"} == {
            name: value for name, value in day.items() if name != "day"
        }, "to the last bit: the same sums in the same order"
    twins.close(10)


@pytest.mark.slow
def test_what_minutes_do_not_tell_is_null_and_said(opened, monkeypatch):
    monkeypatch.setattr("api.twins.days.DAY_S", 900)
    monkeypatch.setattr("api.twins.journal.SEGMENT_ROWS", 100)
    monkeypatch.setattr("api.twins.journal.SEGMENT_ROWS_MAX", 100)
    twins = opened()
    twins.start(TwinRequest(id="t", scenario=scenario_at(METERED), controller="logic", speed="max", at_end="repeat"))
    wait_until(lambda: len(twins.days("t")) > 2)
    twins.stop("t")
    twins.close(10)
    twins = opened()
    before, (day,) = asked(twins, 120, 1500, By.SHIFT, 60), asked(twins, 0, 900)
    assert thin(twins._store, time.time() + 60) > 1500
    told = ("vehicles_arrived", "vehicles_served", "vehicles_connected", "wait_mean_s", "state_of_charge_min")
    sums = ("delivered_kg", "compressor_s", "energy_kwh", "compressor_kwh", "precooler_kwh", "kwh_per_kg")
    unknown = ("dispensing_s", "total_eur", "peak_kw", "compressor_starts", "utilisation", "availability", "refused")
    for whole, each in zip(before, asked(twins, 120, 1500, By.SHIFT, 60), strict=True):
        assert (each["whole_s"], whole["whole_s"]) == (0, 60)
        assert {name: each[name] for name in told} == {name: whole[name] for name in told}
        assert {name: each[name] for name in sums} == {name: near(whole[name]) for name in sums}
        assert {each[name] for name in unknown} == {None}
    for first, end in ((130, 200), (128, 188), (120, 181)):
        (cut,) = asked(twins, first, end)
        assert {cut[name] for name in (*sums, *unknown)} == {None}, "minutes are not cut"
    (again,) = asked(twins, 0, 900)
    assert again["whole_s"] == 0
    kept = {name for name in twins.days("t")[0] if name != "day"}
    assert {name: again[name] for name in kept} == {name: day[name] for name in kept}, "a day was told whole"


@pytest.mark.slow
def test_a_measured_record_tells_what_sensors_read(opened):
    twins, seconds = opened(), 200
    twins.start(measured())
    _send(twins, batches(seconds))
    wait_until(lambda: _taken(twins) == seconds)
    twins.stop("m")
    first, end = 20, 180
    (found,) = asked(twins, first, end, twin="m")
    read = ("flow_dispenser", "vehicle", *VALVES)
    told = twins.columns("m", Selection(tuple(f"measured_{name}" for name in read)))
    missing = np.isnan([told[f"measured_{name}"] for name in read])
    column = {name: _held(told[f"measured_{name}"]) for name in read}
    inlets, outlets = (sum((column[valve] > 0.5).astype(int) for valve in part) for part in (VALVES[:3], VALVES[3:]))
    rows = slice(first, end)
    assert found["delivered_kg"] == pytest.approx(column["flow_dispenser"][rows].sum() / 1000, rel=1e-9)
    assert found["delivered_kg"] > 0
    assert found["compressor_s"] == inlets[rows].sum() > 0
    assert found["dispensing_s"] == (outlets[rows] > 0).sum() > 0
    assert found["compressor_starts"] == np.maximum(np.diff(inlets[first - 1 : end]), 0).sum() > 0
    assert found["occupied_s"] == (column["vehicle"][rows] >= 0).sum() > 0
    assert found["vehicles_connected"] == 1
    assert found["unread_s"] == missing[:, rows].any(axis=0).sum()
    powers = twins.scenario("m").station.powers
    spent = (powers[0] * found["compressor_s"] + powers[1] * found["dispensing_s"]) / 3600
    assert found["energy_kwh"] == near(spent)
    for name in ("vehicles_served", "wait_mean_s", "refused_valves", "refused", "total_eur"):
        assert found[name] is None, name


def _held(values):
    """Each reading from second 19 on, or the one before where it is missing."""
    held = values.copy()
    for row in range(20, len(held)):
        held[row] = held[row - 1] if np.isnan(held[row]) else held[row]
    return held


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"first": 5, "end": 5}, "to_s: must lie behind from_s = 5 s; given 5"),
        ({"first": 9, "end": 10**7}, "to_s: must be at most"),
        ({"first": 10**8, "end": None}, "to_s: must lie behind from_s"),
    ],
)
def test_a_stretch_that_was_not_told_is_named(ended, given, message):
    with pytest.raises(InputError, match=message):
        asked(ended[0], **given)


def test_a_stretch_is_bounded_in_length_and_cuts(ended, monkeypatch):
    monkeypatch.setattr("api.twins.windows.SPAN_MAX_S", 1000)
    with pytest.raises(InputError, match="to_s: must lie at most 1000 s behind from_s = 2 s; given 1003"):
        asked(ended[0], 2, 1003)
    monkeypatch.setattr("api.twins.windows.SPAN_MAX_S", 10**6)
    with pytest.raises(InputError, match="by: must cut the stretch into at most 1000 windows; shift gives 1001"):
        asked(ended[0], 2, 1003, By.SHIFT, 1)


@pytest.mark.parametrize(
    ("shift_h", "begins"),
    [(None, [5, 6, 14, 22, 30, 38, 46]), (12, [5, 6, 18, 30, 42]), (4, [5, 6, *range(10, 50, 4)])],
)
def test_shifts_begin_at_the_hours_that_the_station_says(shift_h, begins):
    early = load_station("thesis-fit").model_copy(update={"shifts": StationShifts(shift_h=8, first_h=6)})
    stretch = Window(5 * HOUR_S, 47 * HOUR_S)
    found = windows_of(stretch, By.SHIFT, Shifts.of(early, shift_h))
    assert [window.first // HOUR_S for window in found] == begins
    assert [window.end for window in found] == [*(HOUR_S * begin for begin in begins[1:]), stretch.end]
    (night, *_) = windows_of(Window(0, 5 * HOUR_S), By.SHIFT, Shifts.of(early))
    assert night == (0, 5 * HOUR_S), "a shift that began the day before goes on over midnight"


def test_a_table_has_a_row_a_window(ended):
    items = asked(ended[0], 0, 600, By.SHIFT, 300)
    table = table_of(items)
    assert list(table) == list(WINDOW_UNITS)
    assert table["from_s"].tolist() == [0, 300]
    assert table["delivered_kg"].tolist() == [each["delivered_kg"] for each in items]
    assert table["refused_gap"].tolist() == [each["refused"]["gap"] for each in items]
    assert set(WINDOW_FLOATS) < set(table)
