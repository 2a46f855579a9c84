"""`switched` under a peak: what the compressor may draw in a quarter, what that saves, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import create
from controllers.switched.peak import (
    EMPTY_FACTOR,
    METER_SIZE,
    PEAK_SIZE,
    QUARTERS,
    SHARES,
    UNHEEDED,
    is_barred,
    peak_in,
    watch_meter,
)
from controllers.switched.settings import SwitchedSettings, scarce_pressure
from controllers.switched.vector import BOUNDED, DEAR_POWER, PEAK, peak_of, settings_vector, shares_of
from station import InputError, Observation, Record, load_scenario, load_station, parse_scenario, simulate
from station.geometry import BUFFERS
from station.parameters import Station

HOURS = [1, 1, 1, 1, 1, 2, 5, 8, 8, 5, 3, 3, 4, 4, 3, 4, 7, 9, 9, 6, 4, 3, 2, 1]
LIGHT = [{"name": "light", "volume_m3": [0.122, 0.157]}]


def day(controller: str, replication: int, count: int = 20, **options) -> Record:
    """A day of vehicles with two peaks at three equal banks."""
    arrivals = {"kind": "profile", "count": count, "hourly_weights": HOURS, "fleet": LIGHT}
    scenario = parse_scenario({"name": "day", "station": {"preset": "h70-equal"}, "arrivals": arrivals})
    return simulate(scenario, create(controller, **options), replication=replication)


@pytest.mark.slow
def test_a_peak_saves_a_tenth_of_the_cost_of_logic_and_no_service():
    days = range(1, 5)
    logic, peak = ([day(name, k) for k in days] for name in ("logic", "switched"))
    cost, less = (np.mean([record.metrics().eur_per_kg for record in each]) for each in (logic, peak))
    assert less < 0.9 * cost
    assert all(record.metrics().vehicles_not_finished == 0 for record in peak)
    fill, slower = (
        np.mean([np.mean(record.vehicles["finished"] - record.vehicles["connected"]) for record in each])
        for each in (logic, peak)
    )
    assert slower < 1.05 * fill


def with_least(pressures: dict[str, float]) -> Station:
    """Three equal banks out of which nothing may flow below these pressures [bar]."""
    given = load_station("h70-equal").model_dump(mode="json")
    given["real_gas"]["bank_pressure_min_bar"] = pressures
    return Station.model_validate(given)


@pytest.mark.slow
@pytest.mark.parametrize("least", [(800.0, 700.0, 600.0), (800.0, 800.0, 800.0)])
def test_nobody_waits_for_a_peak_where_banks_may_give_little(least):
    """Kept below what they may give at all, and barred for its sake, they let vehicles wait for ten minutes."""
    station = with_least(dict(zip(BUFFERS, least, strict=True))).model_dump(mode="json")
    arrivals = {"kind": "poisson", "rate_per_h": 3.0, "period_s": 36_000.0}
    scenario = parse_scenario({"name": "day", "station": station, "arrivals": arrivals})
    waits = {
        name: np.mean([simulate(scenario, create(name), replication=k).metrics().t_avg for k in range(1, 5)])
        for name in ("logic", "switched")
    }
    assert waits["switched"] < 1.35 * waits["logic"]


def test_scarce_gas_is_that_of_two_fills_above_least_pressures():
    assert scarce_pressure(load_station("h70-equal")) == 0.0
    pressures = [scarce_pressure(with_least(dict.fromkeys(BUFFERS, bar))) for bar in (300.0, 600.0, 800.0, 890.0)]
    assert pressures == sorted(pressures)
    assert pressures[0] < 600.0
    assert pressures[-1] == 900.0


@pytest.mark.slow
@pytest.mark.parametrize("most", [8.0, pytest.param(12.0, marks=pytest.mark.slow)])
def test_the_compressor_stays_within_what_is_left_of_the_quarter(most):
    record = day("switched", 2, peak_kw=most)
    station = record.scenario.station
    peak = peak_of(create("switched", peak_kw=most).settings_for(station), station)
    shares = np.array(shares_of(station))
    time, banks = record["time"][:-1], np.array([record[f"pressure_{b}"][:-1] for b in BUFFERS])
    energy = record["energy_compressor"] + record["energy_precooler"]
    used = energy[:-1] - np.interp(time // 900 * 900, record["time"], energy)
    heeded = np.where(banks.mean(axis=0) < peak.empty, EMPTY_FACTOR, shares[(time // 900 % QUARTERS).astype(int)])
    on = sum(record[f"inlet_{b}"][:-1].astype(int) for b in BUFFERS) > 0
    plenty = (banks.max(axis=0) > 850.0) & (record["queue_length"][:-1] == 0)
    assert (on & plenty).sum() > 2000
    assert (used - heeded * most / 4)[on & plenty].max() <= 0.0
    resting = np.bincount((time // 900).astype(int), (~plenty | (record["vehicle"][:-1] >= 0)).astype(float)) == 0
    assert 4 * np.diff(np.interp(np.arange(resting.size + 1) * 900, record["time"], energy))[resting].max() <= 2 * most
    logic, free = day("logic", 2), day("switched", 2, peak_kw=None)
    assert record.metrics().peak_kw < free.metrics().peak_kw
    assert record.metrics().peak_kw < 0.7 * logic.metrics().peak_kw


def test_without_a_charge_or_a_tariff_the_choice_is_none():
    station = load_station("h70-equal")
    free = station.model_copy(update={"tariff": station.tariff.model_copy(update={"demand_eur_per_kw_month": 0.0})})
    auto = SwitchedSettings(peak_kw="auto")
    assert peak_of(auto, free) == UNHEEDED
    assert peak_of(auto, load_station("thesis-fit")) == UNHEEDED
    assert peak_of(auto, station).most == station.compressor.power_kw / 2
    scenario = load_scenario("S1")
    assert simulate(scenario, create("switched", peak_kw="auto")).to_bytes() == (
        simulate(scenario, create("switched")).to_bytes()
    )


def seen(time: float, **given) -> Observation:
    """A second at a station with full banks and no vehicle."""
    usual = Observation(time, 1.0, (850.0, 780.0, 740.0), (25.0,) * 3, -1, np.nan, np.nan, 0.14, True, 0, 0)
    return usual._replace(**given)


def entries_of(most: float) -> np.ndarray:
    station = load_station("thesis-fit")
    return np.append(np.array(peak_of(SwitchedSettings(peak_kw=most), station)), shares_of(station))


def test_a_station_without_a_meter_is_reckoned_by_its_powers():
    entries, memory = entries_of(60.0), np.zeros(METER_SIZE)
    barred = []
    for time in range(899):
        watch_meter(seen(float(time), previous=1 if time else 0), peak_in(entries), memory)
        barred.append(is_barred(seen(float(time), previous=1), entries, memory))
    assert memory[1] == pytest.approx(110.0 * 898 / 3600)
    first = barred.index(True)  # 110 kW, and what is set aside for precooling, reach 60 kW of a quarter
    reserve = peak_in(entries).reserve
    assert 110.0 * first / 3600 + reserve * (900 - first) / 900 == pytest.approx(15.0, abs=0.1)
    assert all(barred[first:])
    assert not is_barred(seen(898.0, queue_length=1), entries, memory)
    assert not is_barred(seen(898.0, pressure=(600.0,) * 3), entries, memory)


def test_a_meter_is_believed_and_a_quarter_begins_anew():
    entries, memory = entries_of(60.0), np.zeros(METER_SIZE)
    for time, energy, barred in ((0.0, 500.0, False), (300.0, 514.0, True), (900.0, 516.0, False)):
        watch_meter(seen(time, energy=energy), peak_in(entries), memory)
        assert is_barred(seen(time), entries, memory) is barred


def test_less_is_heeded_where_energy_is_dear():
    shares = shares_of(load_station("h70-equal"))
    mean = (8 * 0.14 + 10 * 0.24 + 6 * 0.34) / 24
    assert len(shares) == QUARTERS
    assert shares[0] == shares[4 * 23] == 1.0
    assert shares[4 * 10] == pytest.approx((mean / 0.24) ** DEAR_POWER)
    assert shares[4 * 16] == pytest.approx((mean / 0.34) ** DEAR_POWER)
    assert set(shares_of(load_station("thesis-fit"))) == {1.0}
    vector = settings_vector(SwitchedSettings(peak_kw=12.0), load_station("h70-equal"))
    assert vector[PEAK] == 12.0
    assert vector[PEAK + SHARES : BOUNDED].tolist() == shares
    assert vector.size == BOUNDED + 1 == PEAK + PEAK_SIZE + 1


@pytest.mark.parametrize(("given", "message"), [(0.0, "greater than 0"), (-3.0, "greater than 0"), ("most", "'auto'")])
def test_a_peak_is_a_power_or_auto(given, message):
    with pytest.raises(InputError, match="peak_kw") as error:
        create("switched", peak_kw=given)
    assert message in str(error.value)


def test_a_peak_needs_the_powers():
    station = load_station("thesis-fit")
    silent = station.model_copy(update={"compressor": station.compressor.model_copy(update={"power_kw": None})})
    with pytest.raises(InputError, match=r"compressor\.power_kw"):
        simulate(load_scenario("S1").on(silent), create("switched", peak_kw=50.0))
