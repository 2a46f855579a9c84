"""Tariffs: what is refused, prices by the clock, and figures of money against sums done by hand over a record."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from api.comparisons.export import csv_of
from api.comparisons.service import as_document
from api.comparisons.tables import COSTS, OURS, tables
from api.runs.service import Result
from controllers import create
from station import InputError, Record, Station, load_scenario, load_station, parse_scenario, simulate
from station.costs import COST_UNITS
from station.metrics import UNITS
from station.plants.real_gas.compressor import compressor_work
from station.plants.real_gas.leachman import properties
from station.plants.real_gas.registration import REAL_GAS
from station.tariff import Period, Tariff

DAY = {
    "name": "day", "station": {"preset": "h70-equal"},
    "arrivals": {"kind": "uniform", "count": 6, "period_s": 10_000.0},
}  # fmt: skip
PRICES = [(0.0, 6.0, 0.14), (6.0, 16.0, 0.24), (16.0, 22.0, 0.34), (22.0, 24.0, 0.14)]


def periods(given):
    return [{"from_h": begin, "to_h": end, "eur_per_kwh": price} for begin, end, price in given]


def with_tariff(record: Record, **changes) -> Record:
    """The record at a station whose tariff has these prices."""
    station = record.scenario.station
    energy = [Period(from_h=begin, to_h=end, eur_per_kwh=price) for begin, end, price in PRICES]
    tariff = Tariff(**({"energy": energy, "demand_eur_per_kw_month": 12.0} | changes))
    changed = station.model_copy(update={"tariff": tariff})
    return replace(record, scenario=record.scenario.model_copy(update={"station": changed}))


@cache
def gas_day() -> Record:
    """Vehicles from before six o'clock to after it, at a station of real gas."""
    scenario = {**DAY, "arrivals": {"kind": "profile", "count": 6, "hourly_weights": [0, 0, 0, 0, 0, 1, 1]}}
    return simulate(parse_scenario(scenario), create("logic"), replication=1)


@cache
def thesis_day() -> Record:
    return simulate(load_scenario("S1"), create("logic"))


@pytest.mark.parametrize(
    ("given", "field", "message"),
    [
        ([], "energy", "at least 1"),
        ([(0.0, 6.0, 0.1)], "energy", "nothing from 6 to 24 h"),
        ([(1.0, 24.0, 0.1)], "energy", "nothing from 0 to 1 h"),
        ([(0.0, 6.0, 0.1), (7.0, 24.0, 0.1)], "energy", "nothing from 6 to 7 h"),
        ([(0.0, 6.0, 0.1), (5.0, 24.0, 0.1)], "energy", "must not overlap; two from 5 to 6 h"),
        ([(0.0, 24.0, 0.1), (3.0, 8.0, 0.2)], "energy", "must not overlap; two from 3 to 8 h"),
        ([(0.0, 6.0, -0.1), (6.0, 24.0, 0.1)], "energy.0.eur_per_kwh", "greater than or equal to 0; given -0.1"),
        ([(22.0, 6.0, 0.1)], "energy.0", "from_h must lie before to_h = 6 h; given 22 h"),
    ],
)
def test_a_bad_tariff_is_refused_by_field_and_limit(given, field, message):
    scenario = {**DAY, "station": {"preset": "h70-equal", "tariff": {"energy": periods(given)}}}
    with pytest.raises(InputError) as error:
        parse_scenario(scenario)
    assert [path for path, _ in error.value.problems] == [f"station.tariff.{field}"]
    assert message in str(error.value)


@pytest.mark.parametrize("name", ["demand_eur_per_kw_month", "stock_eur_per_kg", "hydrogen_eur_per_kg"])
def test_no_price_is_negative(name):
    with pytest.raises(InputError, match=f"tariff.{name}: .*greater than or equal to 0; given -1"):
        parse_scenario({**DAY, "station": {"preset": "h70-equal", "tariff": {"energy": periods(PRICES), name: -1.0}}})


def test_a_tariff_needs_powers_where_the_plant_keeps_no_account():
    station = load_station("thesis-fit").model_dump()
    station["tariff"] = {"energy": periods(PRICES)}
    assert Station.model_validate(station).tariff.mean == pytest.approx((8 * 0.14 + 10 * 0.24 + 6 * 0.34) / 24)
    station["precooler"]["power_kw"] = None
    with pytest.raises(ValueError, match=r"tariff needs compressor\.power_kw and precooler\.power_kw"):
        Station.model_validate(station)


def test_prices_by_the_clock():
    tariff = Tariff(energy=[Period(from_h=b, to_h=e, eur_per_kwh=p) for b, e, p in reversed(PRICES)])
    hours = np.array([0.0, 5.99, 6.0, 15.99, 16.0, 21.99, 22.0, 24.0, 30.0])
    assert tariff.price_at(hours * 3600).tolist() == [0.14, 0.14, 0.24, 0.24, 0.34, 0.34, 0.14, 0.14, 0.24]
    assert tariff.changes(31 * 3600.0).tolist() == [h * 3600.0 for h in (0, 6, 16, 22, 24, 30, 31)]


def by_hand(record: Record, power: np.ndarray) -> tuple[float, float]:
    """Energy [EUR] and peak [kW], second by second from the power of each."""
    spans = np.diff(record["time"]).astype(int)
    each = np.repeat(power[:-1], spans)
    seconds = np.arange(each.size)
    price = np.select([(seconds // 3600) % 24 < end for _, end, _ in PRICES], [price for _, _, price in PRICES])
    quarters = [each[begin : begin + 900].sum() / 900 for begin in range(0, each.size, 900)]
    return float((each * price).sum() / 3600), max(quarters)


def check(record: Record, power: np.ndarray, stock_kwh: float) -> None:
    found = record.metrics()
    energy, peak = by_hand(record, power)
    mean = (8 * 0.14 + 10 * 0.24 + 6 * 0.34) / 24
    demand = peak * 12.0 * record["time"][-1] / (365 * 86_400 / 12)
    assert found.energy_eur == pytest.approx(energy, rel=1e-9)
    assert found.peak_kw == pytest.approx(peak, rel=1e-9)
    assert found.demand_eur == pytest.approx(demand, rel=1e-9)
    assert found.stock_eur == pytest.approx(mean * stock_kwh, rel=2e-3)
    assert found.total_eur == pytest.approx(energy + demand + found.stock_eur, rel=1e-9)
    assert found.eur_per_kg == pytest.approx(found.total_eur / found.delivered, rel=1e-9)
    assert found.kwh_per_kg == pytest.approx(found.energy_kwh / found.delivered, rel=1e-9)
    assert set(found) == {*UNITS, *COST_UNITS} - {"revenue_eur"}


@pytest.mark.slow
def test_money_of_a_station_of_real_gas_is_an_independent_sum_over_its_record():
    record = gas_day()
    assert record["time"][-1] > 6 * 3600
    assert (np.diff(record["time"]) == 1.0).all()
    constants = REAL_GAS.constants_of(record.scenario.station, communication=True)
    stock = 0.0
    for name in ("high", "medium", "low"):
        grams, goal = record[f"mass_{name}"][-1], record[f"mass_{name}"][0]
        while grams < goal:  # a gram at a time at 25 deg C
            pressure = properties(np.array([grams / 1000 / 0.5]), np.array([298.15])).pressure[0]
            stock += compressor_work(float(pressure), constants.station.compressor) * min(1.0, goal - grams) / 1000
            grams += 1.0
    assert stock > 0
    check(record, record["power_compressor"] + record["power_precooler"], stock / 3.6e6)


def test_money_of_a_station_of_the_thesis_is_of_its_powers():
    record = with_tariff(thesis_day())
    inlets = sum(record[f"inlet_{b}"].astype(float) for b in ("high", "medium", "low"))
    outlets = sum(record[f"outlet_{b}"].astype(float) for b in ("high", "medium", "low"))
    plain = thesis_day().metrics()
    missing = 110.0 * (plain.t_comp_restored - plain.t_comp) / 3600
    check(record, 110.0 * inlets + 55.0 * outlets, missing)


def test_stock_and_hydrogen_have_prices_of_their_own():
    record = with_tariff(gas_day(), stock_eur_per_kg=7.0, hydrogen_eur_per_kg=11.0)
    missing = sum(max(0.0, record[f"mass_{n}"][0] - record[f"mass_{n}"][-1]) for n in ("high", "medium", "low"))
    found = record.metrics()
    assert found.stock_eur == pytest.approx(7.0 * missing / 1000, rel=1e-9)
    assert found.revenue_eur == pytest.approx(11.0 * found.delivered, rel=1e-9)


def test_a_station_without_a_tariff_says_nothing_of_money():
    record = thesis_day()
    assert set(record.metrics()) == set(UNITS)
    assert "tariff" not in json.loads(record.scenario.model_dump_json())["station"]
    result = Result("S1", "logic", 0, 0, record.metrics())
    assert as_document([result])["units"] == UNITS
    assert tables([record.scenario], [result])[0].headings == tuple(OURS.values())
    with pytest.raises(KeyError):
        record.metrics()["total_eur"]


def test_tables_rows_and_files_have_money_where_there_is_a_tariff():
    gas, plain = gas_day(), thesis_day()
    found = [Result("day", "logic", 1, 0, gas.metrics()), Result("S1", "logic", 0, 0, plain.metrics())]
    document = as_document(found)
    assert set(document["units"]) == {*UNITS, *COST_UNITS} - {"revenue_eur"}
    assert [Result.from_row(row) for row in document["results"]] == found
    first, second = csv_of(document["results"]).splitlines()[1:]
    assert second.endswith("," * 7)
    assert not first.endswith(",")
    shown = tables([gas.scenario, plain.scenario], found)
    assert [table.headings for table in shown] == [tuple({**OURS, **COSTS}.values()), tuple(OURS.values())]
    row = dict(zip(shown[0].headings, shown[0].rows[0].cells, strict=True))
    assert row["EUR/kg"] == f"{gas.metrics().eur_per_kg:.3f}"
    assert row["peak [kW]"] == f"{gas.metrics().peak_kw:.1f}"


def test_a_record_keeps_its_tariff():
    record = gas_day()
    assert Record.from_parquet(record.parquet()).metrics() == record.metrics()
