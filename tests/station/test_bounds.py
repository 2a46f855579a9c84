"""Bounds hold for controllers of every kind, and each inequality of their proof in states of every kind."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from controllers import create
from controllers.base import BaseController
from station import Decision, InputError, load_scenario, load_station, parse_scenario, simulate
from station.bounds import COARSE, Resolution, StationPrices, bounds
from station.bounds import scenario as scenario_module
from station.bounds.grid import KELVIN
from station.bounds.proof import prove_buffer_potential
from station.bounds.queue import Price, Queue, least_restored, least_wait
from station.bounds.scale import Scale
from station.bounds.scenario import _classes, _family
from station.bounds.service import prove_service
from station.bounds.service_proposal import ServiceProposer
from station.plants.thesis import buffer_temperature, inlet_flow, outlet_flow, vehicle_temperature
from station.valves import commands
from tests.samples import first_quick

SMALL = Resolution(reference=6, warm=60.0, cold=90.0, pressure=5, temperature=2, flows=6, step=5.0)
PRESETS = ("thesis-fit", "thesis-fit-a", "thesis-fit-b", "thesis-fit-cascade", "light-duty-700")


class Scattered(BaseController):
    """Random commands, each kept for a while; the shield closes what a limit forbids."""

    name = "scattered"

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._random = np.random.default_rng(seed)
        self._left, self._command = 0, 0

    def decide(self, seen):
        if self._left <= 0:
            self._left = int(self._random.integers(1, 40))
            self._command = int(self._random.choice([c for c in commands(3) if c >> 3]))
        self._left -= 1
        return Decision(self._command)


@pytest.fixture(scope="module", autouse=True)
def _few():
    """One mix of prices and four tangents: any number of either gives bounds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenario_module, "DESIGN_PRICES", ((0.3, 0.15, 0.0),))
        patch.setattr(scenario_module, "SERVICE_PRICES", (0.0, 0.15, 0.4, 1.0))
        yield


@pytest.fixture(scope="module")
def priced(_few):
    """`priced(name)`: the prices of a preset."""

    @cache
    def prices(name):
        scenarios = [load_scenario(item).on(load_station(name)) for item in ("S1", "S3")]
        return StationPrices.of(
            [item.vehicles() for item in scenarios], scenarios[0], COARSE if name == "thesis-fit" else SMALL
        )

    return prices


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(PRESETS))
@pytest.mark.parametrize("scenario", ["S1", "S3"])
def test_no_controller_is_below(priced, name, scenario):
    chosen = load_scenario(scenario).on(load_station(name))
    actors = [create(item) for item in ("logic", "minlp1", "minlp2", "minlp3")]
    if scenario == "S1":
        actors += [Scattered(seed) for seed in range(4)]
    runs = [simulate(chosen, actor).metrics() for actor in actors]
    served = [run for run in runs if run.vehicles_not_finished == 0]
    found = bounds(chosen, [run.t_total for run in served], prices=priced(name))
    for run, point in zip(served, found.trade_off, strict=True):
        assert run.t_comp_restored >= point.restored >= found.t_comp_restored - 1
        assert run.t_total >= found.t_total


@pytest.mark.slow
def test_the_bound_is_worth_something(priced):
    found = bounds(load_scenario("S3"), [50_703.0], prices=priced("thesis-fit"))
    assert found.trade_off[0].restored > 0.4 * 28_034


@pytest.mark.slow
@settings(max_examples=3, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.sampled_from(PRESETS[:3]),
    st.integers(1, 4),
    st.floats(0.7, 1.5),
    st.lists(st.floats(0, 900), min_size=1, max_size=3),
    st.integers(0, 100),
)
def test_no_controller_is_below_on_stations_nobody_thought_of(name, count, size, times, seed):
    base = load_station(name)
    vehicles = [
        {"time_s": time, "start_pressure_bar": 100.0 + 20 * i, "volume_m3": base.vehicle.volume_m3 * (1 + 0.1 * i)}
        for i, time in enumerate(times)
    ]
    given_ = {
        "name": "drawn",
        "station": {
            "preset": name,
            "compressor": {"count": count},
            "buffers": {"low": {"volume_m3": size * base.buffers.low.volume_m3}},
        },
        "arrivals": {"kind": "trace", "vehicles": vehicles},
    }
    scenario = parse_scenario(given_)
    runs = [simulate(scenario, actor).metrics() for actor in (create("logic"), create("minlp1"), Scattered(seed))]
    served = [run for run in runs if run.vehicles_not_finished == 0]
    found = bounds(scenario, [run.t_total for run in served], resolution=SMALL)
    for run, point in zip(served, found.trade_off, strict=True):
        assert run.t_comp_restored >= point.restored
        assert run.t_total >= found.t_total


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(PRESETS))
@pytest.mark.parametrize("wild", [False, True])
def test_every_inequality_holds_in_random_states_and_corners(priced, name, wild):
    """Random proposals are proved, too: only the proof may be trusted."""
    known, random = priced(name), np.random.default_rng(1)
    grid, stock = known.grid, known.stocks[0]
    plant, volume = grid.plant, grid.station.vehicle.volume_m3
    if wild:
        shape = grid.stock_axes[0].count, grid.stock_axes[1].count
        stock = prove_buffer_potential(grid, [np.cumsum(random.random(shape), axis=0) for _ in range(3)])
    proposed = ServiceProposer(grid, (volume, volume), float(grid.pressure[1])).propose(stock, 0.3)
    if wild:
        proposed = np.minimum(proposed, 0) + 5 * random.random(proposed.shape)
    service = prove_service(grid, stock, proposed, (volume, volume))

    def held(buffer, r, t):
        return grid.stock_value(stock.values[buffer], r, t)

    def worth(p, t):
        return grid.service_value(service.values, min(p, grid.pressure[-1]), t)

    tried = 0
    for _ in range(1500):
        buffer = int(random.integers(3))
        kappa = grid.kappa[buffer]
        t = float(random.choice([random.uniform(*grid.temperature[[0, -1]]), *grid.temperature]))
        r = float(random.uniform(grid.reference[0], plant.compressor_pressure / float(grid.theta(np.float64(t)))))
        p = r * float(grid.theta(np.float64(t)))
        before = held(buffer, r, t)
        rest = buffer_temperature(buffer, t, 0, 0, plant, 1.0)
        assert held(buffer, r, rest) <= before + 1e-9
        warm = buffer_temperature(buffer, t, 1, 0, plant, 1.0)
        if p < plant.compressor_pressure and warm <= plant.limits.buffer_temperature_max:
            assert held(buffer, r + kappa * inlet_flow(p, plant), warm) <= before + 1
        tv = float(random.uniform(*grid.vehicle_temperature[[0, -1]]))
        pv = float(random.uniform(grid.pressure[0], max(grid.pressure[0], min(grid.pressure[-1], p))))
        theta = (tv + KELVIN) / (plant.ambient_temperature + KELVIN)
        later = vehicle_temperature(tv, 0.0, plant, 1.0)
        assert worth(pv * (later + KELVIN) / (tv + KELVIN), later) - worth(pv, tv) <= service.price
        flow = outlet_flow(p, pv, plant)
        hot = vehicle_temperature(tv, 1.0, plant, 1.0)
        if not grid.flow_range[0] <= flow <= grid.flow_range[1] or hot > plant.limits.vehicle_temperature_max:
            continue
        cool = buffer_temperature(buffer, t, 0, 1, plant, 1.0)
        end = (pv + grid.bar_per_gram(volume) * theta * flow) * (hot + KELVIN) / (tv + KELVIN)
        gained = worth(end, hot) - worth(pv, tv)
        assert gained <= before - held(buffer, r - kappa * flow, cool) + service.price
        tried += 1
    assert tried > 50


def test_a_dual_is_summed_and_not_believed(monkeypatch):
    queue = Queue(np.array([0.0, 100.0, 200.0]), np.full(3, 150.0), 1, 10_000.0)
    assert least_wait(queue, []) == pytest.approx(150.0, abs=0.01)
    family = Price(np.array([[50.0] * 3, [200.0] * 3]), np.array([0.0, 0.5]), -10.0, 1e6)
    exact = least_restored(queue, [family], 150.0)
    assert exact == pytest.approx(2 * (200 - 0.5 * 150) + 50 - 10, abs=0.1)
    assert least_restored(queue, [family], 100.0) == np.inf
    from station.bounds import queue as module

    def liar(*arguments, **options):
        found = solve(*arguments, **options)
        if found.x is not None:
            found.ineqlin.marginals *= 3.0
        return found

    solve = module.linprog
    monkeypatch.setattr(module, "linprog", liar)
    assert least_restored(queue, [family], 150.0) <= exact


@pytest.mark.slow
def test_families_fall_short_of_every_fill(priced):
    chosen = load_scenario("S3").on(load_station("thesis-fit"))
    record = simulate(chosen, create("minlp3"))
    seconds = record.vehicles["finished"] - record.vehicles["connected"]
    grid, vehicles = priced("thesis-fit").grid, chosen.vehicles()
    for stock in priced("thesis-fit").stocks:
        family = _family(grid, stock, vehicles, _classes(grid, vehicles))
        least = (family.gains - family.prices[:, None] * seconds).max(axis=0)
        assert least.sum() + family.boundary <= record.metrics().t_comp_restored


def test_a_station_without_heat_exchange_is_refused():
    scenario = parse_scenario(
        {"name": "x", "station": {"preset": "thesis-fit", "thermal": {"heat_exchange_per_s": 0.0}},
         "arrivals": {"kind": "uniform", "count": 2, "period_s": 100}}
    )  # fmt: skip
    with pytest.raises(InputError, match="heat_exchange_per_s"):
        bounds(scenario, resolution=COARSE)


def test_a_scale_has_the_rate_it_says_and_an_inverse():
    scale = Scale(1000.0, 20.0)
    pressure = np.linspace(0.0, 1200.0, 4801)
    place = scale.position(pressure)
    assert scale.pressure(place) == pytest.approx(pressure, abs=1e-9)
    assert np.diff(place) / np.diff(pressure) == pytest.approx(scale.rate(pressure[:-1] + 0.125), rel=1e-4)


@pytest.mark.parametrize("price", [0.0, 0.2, 1.0])
def test_a_price_is_proved_nearly_as_asked(priced, price):
    known = priced("thesis-fit")
    volume, vehicle = (known.grid.station.vehicle.volume_m3,) * 2, known.grid.station.vehicle
    proposed = ServiceProposer(known.grid, volume, vehicle.start_pressure_bar).propose(known.stocks[-1], price)
    service = prove_service(known.grid, known.stocks[-1], proposed, volume)
    assert service.price == pytest.approx(price, abs=0.004)
    start = vehicle.start_pressure_bar, vehicle.start_temperature_c, vehicle.finish_pressure_bar
    assert service.gain(known.grid, *start) > 90
