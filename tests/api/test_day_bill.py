"""What a twin's day costs is what `station.costs` says of the record of the same seconds, wherever restarts cut it."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from api.twins.day_bill import BILL
from api.twins.day_schemas import TwinDay
from api.twins.days import DAY_S, document
from controllers import create_from
from station import parse_scenario, simulate
from station.costs import METERS, costs
from tests.api.test_days import lived

FLAT = [{"from_h": 0.0, "to_h": 24.0, "eur_per_kwh": 0.2}]
CHANGING = [
    {"from_h": 0.0, "to_h": 0.1501, "eur_per_kwh": 0.11},
    {"from_h": 0.1501, "to_h": 0.4, "eur_per_kwh": 0.37},
    {"from_h": 0.4, "to_h": 24.0, "eur_per_kwh": 0.2},
]
METERED = {"preset": "h70-light"}
POWERED = {"preset": "thesis-fit", "compressor": {"power_kw": 30.0}, "precooler": {"power_kw": 12.0}}


def _scenario(station, energy, count=4, **tariff):
    tariff = {"energy": energy, "demand_eur_per_kw_month": 12.0, **tariff}
    arrivals = {"kind": "uniform", "count": count, "period_s": 700.0}
    document = {"name": "paid", "station": {**station, "tariff": tariff}, "arrivals": arrivals, "idle_period_s": 1}
    return parse_scenario(document)


def _told(record, first, end):
    """The costs of the seconds of a record from `first` to `end`, as if it had begun then."""
    values = record.values[:, first : end + 1].copy()
    values[0] -= first
    cut = replace(
        record, values=values, codes=record.codes[:, first : end + 1], counts=record.counts[:, first : end + 1]
    )
    return costs(cut, float(cut["flow_dispenser"][:-1].sum()) / 1000, 0.0)


@pytest.mark.parametrize("station", [METERED, POWERED], ids=["metered", "powered"])
@pytest.mark.parametrize("tariff", [{}, {"stock_eur_per_kg": 3.0}], ids=["restored", "bought"])
def test_a_day_of_a_whole_run_costs_what_its_record_costs(station, tariff):
    scenario = _scenario(station, CHANGING, **tariff)
    (day,), _ = lived(scenario, "logic", DAY_S, {301, 901})
    record = simulate(scenario, create_from("logic"))
    told = record.metrics()
    assert told["energy_eur"] > 0
    assert told["demand_eur"] > 0
    assert {name: day[name] for name in BILL} == pytest.approx({name: told[name] for name in BILL}, rel=1e-9)
    shown = TwinDay.model_validate(document(day))
    assert shown.total_eur == pytest.approx(day["energy_eur"] + day["demand_eur"] + day["stock_eur"], rel=1e-12)


@pytest.mark.parametrize("station", [METERED, POWERED], ids=["metered", "powered"])
def test_every_day_costs_what_the_record_of_its_seconds_costs(station):
    scenario = _scenario(station, FLAT)
    days, ended = lived(scenario, "logic", 400, {200, 400, 401, 1100})
    record = simulate(scenario, create_from("logic"))
    assert len(days) > 2
    assert [document(day) for day in ended] == [document(day) for day in days[: len(ended)]]
    for day in days:
        told = _told(record, int(day["from_s"]), int(day["to_s"]))
        expected = {name: told[name] if math.isfinite(told[name]) else None for name in BILL}
        shown = document(day)
        assert {name: shown[name] for name in BILL} == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert max(day["stock_eur"] for day in days) > 0


def test_energy_has_the_price_of_its_time_in_every_day():
    scenario = _scenario(METERED, CHANGING)
    days, _ = lived(scenario, "logic", 1000, {500})
    record = simulate(scenario, create_from("logic"))
    meter = record[METERS[0]] + record[METERS[1]]
    assert meter[-1] > 1
    total = record.metrics()["energy_eur"]
    assert sum(day["energy_eur"] for day in days) == pytest.approx(total, rel=1e-9)


def test_a_station_without_tariff_has_no_figures_of_money():
    arrivals = {"kind": "uniform", "count": 1, "period_s": 700.0}
    scenario = parse_scenario({"name": "free", "station": {"preset": "thesis-fit"}, "arrivals": arrivals})
    (day,), _ = lived(scenario, "logic", DAY_S, {100})
    shown = document(day)
    assert [shown[name] for name in BILL] == [None] * len(BILL)
