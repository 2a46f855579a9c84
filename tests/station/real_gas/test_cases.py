"""Measured cases: the bars on the open ones, every kind of boundary, and files that are none."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.errors import InputError
from station.files import parse_file
from station.plants.real_gas.cases import parse_case
from station.plants.real_gas.comparison import compare_case, implied_coefficients, measured_gas
from station.plants.real_gas.replay import replay
from tests.station.real_gas.referee import FOLDER, measured

BARS = {
    "dicken-type3": (4.0, 9.0),
    "striednig-05": (4.0, None),
    "striednig-30": (4.0, None),
    "byrnes-7": (4.0, 3.5),
    "byrnes-8": (4.0, 3.5),
    "demiguel-type4": (4.0, None),
    "woodfield-fill": (9.0, None),
}


def case_of(name):
    path = Path(FOLDER) / f"{name}.json"
    return parse_case(parse_file(path, str(path)), str(path))


@measured
@pytest.mark.parametrize("name", BARS)
def test_the_open_cases(name):
    case = case_of(name)
    found = compare_case(case, name)
    gas, pressure = BARS[name]
    assert found.gas_difference.rms < gas
    assert found.gas_difference.largest < 2.5 * gas
    if pressure:
        assert found.pressure_difference.rms < pressure
    assert (found.area is not None) == name.startswith("byrnes")


@measured
def test_choked_flow_through_orifices_is_of_the_right_size():
    for name, low, high in (("proust-orifice-1mm", 0.9, 1.3), ("proust-orifice-3mm", 0.4, 0.8)):
        implied = implied_coefficients(case_of(name))
        assert low < implied.min() <= implied.max() < high


FILL = {
    "case": "precooled type IV, 70 MPa",
    "kind": "fill",
    "gas": "hydrogen",
    "tank": {
        "type": "IV", "volume_m3": 0.1224, "inner_diameter_m": 0.33, "inner_length_m": 1.431, "inlet_diameter_m": None,
        "layers": [
            {
                "name": "HDPE", "thickness_m": 0.005, "density_kg_m3": 945, "heat_capacity_J_kgK": 1584.0,
                "conductivity_W_mK": 0.385,
            },
            {
                "name": "CFRP", "thickness_m": 0.03, "density_kg_m3": 1360.0, "heat_capacity_J_kgK": 1020.0,
                "conductivity_W_mK": 0.5,
            },
        ],
    },
    "initial": {"pressure_MPa": 5.0, "temperature_K": 293.15},
    "ambient": {"temperature_K": 293.15, "outer_coefficient_W_m2K": 8.0},
    "end_time_s": 240,
    "boundary": {
        "pressure_ramp_MPa_per_min": 20.0,
        "end_pressure_MPa": 75,
        "inlet_temperature_K": {"time_s": [0.0, 30.0, 240.0], "value": [290.0, 240.0, 238.0]},
    },
    "measured": {"gas_mean_temperature_K": {"time_s": [0.0, 240.0], "value": [293.15, 340.0]}},
}  # fmt: skip


def changed(**boundary):
    """The fill with another boundary, or with None without a field."""
    document = deepcopy(FILL)
    document["boundary"] = {**document["boundary"], **boundary}
    document["boundary"] = {name: value for name, value in document["boundary"].items() if value is not None}
    return document


def run(document):
    return replay(parse_case(document, "case"), "case")


def series(time, values, every=20):
    return {"time_s": time[::every].tolist(), "value": values[::every].tolist()}


RAMP = run(FILL)
NO_RAMP = {"pressure_ramp_MPa_per_min": None, "end_pressure_MPa": None}


def test_a_ramp_holds_its_pressure_and_then_closes():
    until = RAMP.time < 209
    assert RAMP.pressure[until] / 1e6 == pytest.approx(5 + RAMP.time[until] / 3, abs=0.01)
    assert RAMP.pressure.max() / 1e6 == pytest.approx(75, abs=0.01)
    assert RAMP.mass[-1] == RAMP.mass[RAMP.time > 211][0]
    assert RAMP.pressure[-1] < RAMP.pressure.max()


def test_a_followed_pressure_is_the_ramp():
    followed = run(changed(pressure_MPa=series(RAMP.time, RAMP.pressure / 1e6, 1), **NO_RAMP))
    assert followed.temperature == pytest.approx(RAMP.temperature, abs=0.1)
    assert followed.mass == pytest.approx(RAMP.mass, rel=1e-3)


def test_a_series_that_begins_late_begins_at_the_start():
    late = {"time_s": [30.0, 210.0], "value": [15.0, 75.0]}
    found = run(changed(pressure_MPa=late, **NO_RAMP))
    assert found.pressure[found.time < 209] == pytest.approx(RAMP.pressure[RAMP.time < 209], abs=2e4)
    assert found.mass[-1] == found.mass[found.time > 211][0]


def test_the_flow_of_a_ramp_gives_its_pressure_back():
    flow = np.gradient(RAMP.mass, RAMP.time)
    found = run(changed(mass_flow_kg_s=series(RAMP.time, flow / 0.8, 1), mass_flow_factor=0.8, **NO_RAMP))
    assert found.mass == pytest.approx(RAMP.mass, rel=2e-3)
    assert found.pressure == pytest.approx(RAMP.pressure, rel=5e-3)
    assert found.temperature == pytest.approx(RAMP.temperature, abs=0.5)


def test_a_constant_flow_is_a_number():
    found = run(changed(mass_flow_kg_s=0.015, **NO_RAMP))
    assert found.mass[-1] - found.mass[0] == pytest.approx(0.015 * 240, rel=1e-9)


def test_the_inlet_may_have_a_pressure_of_its_own():
    """-35 degC taken at 75 MPa throughout is much warmer gas than at the pressure of the tank."""
    cold = {"inlet_temperature_K": 238.0}
    own, high = run(changed(**cold)), run(changed(inlet_pressure_MPa=75.0, **cold))
    supply = run(changed(inlet_temperature_K=None, supply_temperature_K=238.0, supply_pressure_MPa=75.0))
    assert 8 < high.temperature[-1] - own.temperature[-1] < 16
    assert supply.temperature == pytest.approx(high.temperature, abs=1e-9)


def test_a_supply_fills_through_an_orifice():
    found = run(
        changed(
            orifice={"diameter_m": 0.001, "discharge_coefficient": 0.9}, supply_temperature_K=253.15,
            supply_pressure_MPa=60.0, inlet_temperature_K=None, **NO_RAMP,
        )
    )  # fmt: skip
    assert np.all(np.diff(found.pressure) > 0)
    assert found.pressure[-1] < 60e6


def test_an_orifice_empties_a_tank_to_its_back_pressure():
    document = changed(orifice={"diameter_m": 0.004, "back_pressure_MPa": 2.0}, inlet_temperature_K=None, **NO_RAMP)
    document["kind"] = "discharge"
    document["initial"]["pressure_MPa"] = 20.0
    found = run(document)
    assert found.pressure[-1] / 1e6 == pytest.approx(2.0, abs=0.01) or found.pressure[-1] > 2e6
    assert np.all(np.diff(found.mass) <= 0)
    assert found.temperature.min() < 260


def test_an_unpublished_area_is_found_from_the_pressure():
    document = changed(orifice={"diameter_m": 0.002, "back_pressure_MPa": 0.1}, inlet_temperature_K=None, **NO_RAMP)
    document["kind"] = "discharge"
    document["initial"]["pressure_MPa"] = 20.0
    true = run(document)
    document["measured"] = {"pressure_MPa": series(true.time, true.pressure / 1e6, 100)}
    as_published = compare_case(parse_case(document, "case"), "case")
    assert as_published.area is None
    document["boundary"]["orifice"]["diameter_m"] = None
    found = compare_case(parse_case(document, "case"), "case")
    assert found.area == pytest.approx(np.pi / 4 * 0.002**2, rel=2e-3)
    assert found.pressure_difference.rms < 0.1
    document["boundary"]["orifice"]["diameter_m"] = 0.001
    document["notes"] = ["the opening of the valve was not published"]
    assert compare_case(parse_case(document, "case"), "case").area == pytest.approx(found.area, rel=1e-3)


def test_what_is_compared():
    document = changed()
    low = {"time_s": [0.0, 100.0], "value": [290.0, 300.0]}
    high = {"time_s": [50.0, 150.0], "value": [300.0, 320.0]}
    document["measured"] = {
        "gas_low_temperature_K": low,
        "gas_high_temperature_K": high,
        "remark": "read from a figure",
    }
    found = measured_gas(parse_case(document, "case"))
    assert found.time.tolist() == [50.0, 100.0]
    assert found.value.tolist() == [(295 + 300) / 2, (300 + 310) / 2]
    document["measured"] = {"gas_high_temperature_K": high}
    assert measured_gas(parse_case(document, "case")).name == "gas_high_temperature_K"
    document["measured"] = {"pressure_MPa": low}
    case = parse_case(document, "case")
    assert measured_gas(case) is None
    assert compare_case(case, "case").gas_difference is None


def test_the_comparison_ends_where_the_case_says():
    document = changed()
    computed = RAMP.temperature[::200] + np.where(RAMP.time[::200] > 100, 50.0, 1.0)
    document["measured"] = {"gas_mean_temperature_K": {"time_s": RAMP.time[::200].tolist(), "value": computed.tolist()}}
    document["compare_until_s"] = 100
    found = compare_case(parse_case(document, "case"), "case")
    assert found.gas_difference.rms == pytest.approx(1.0, abs=1e-9)
    assert found.gas_difference.largest == pytest.approx(1.0, abs=1e-9)


def without(name):
    document = deepcopy(FILL)
    del document[name]
    return document


def with_initial(**given):
    document = deepcopy(FILL)
    document["initial"].update(given)
    return document


@pytest.mark.parametrize(
    ("document", "field", "message"),
    [
        (without("tank"), "tank", "Field required"),
        ({**FILL, "gas": "helium"}, "gas", "'hydrogen'; given 'helium'"),
        ({**FILL, "kind": "sideways"}, "kind", "'fill' or 'discharge'; given 'sideways'"),
        (with_initial(pressure_MPa=-1.0), "initial.pressure_MPa", "greater than 0; given -1.0"),
        (with_initial(temperature_K=20.0), "initial.temperature_K", "greater than or equal to 120; given 20.0"),
        (with_initial(pressure_MPa="5"), "initial.pressure_MPa", "valid number; given '5'"),
        (with_initial(pressure_MPa=float("nan")), "initial.pressure_MPa", "finite number; given nan"),
        (changed(**NO_RAMP), "boundary", "must drive the tank; given none"),
        (changed(mass_flow_kg_s=0.01), "boundary", "given mass_flow_kg_s, pressure_ramp_MPa_per_min"),
        (changed(mass_flow_kgs=0.01), "boundary.mass_flow_kgs", "Extra inputs are not permitted; given 0.01"),
        (changed(end_pressure_MPa=None), "boundary", "end_pressure_MPa must say where"),
        (changed(inlet_temperature_K=None), "", "must say what gas comes in"),
        (changed(inlet_temperature_K=None, supply_temperature_K=240.0), "", "supply_pressure_MPa must stand beside"),
        (changed(inlet_temperature_K=900.0), "boundary", "inlet_temperature_K must lie between 120 and 520; given 900"),
        (
            changed(inlet_temperature_K={"time_s": [0.0, 1.0], "value": [240.0]}),
            "boundary.inlet_temperature_K", "must be as many; given 2 and 1",
        ),
        (
            changed(inlet_temperature_K={"time_s": [2.0, 1.0], "value": [240.0, 241.0]}),
            "boundary.inlet_temperature_K", "must not fall; 1 s comes after 2 s",
        ),
        (changed(orifice={"diameter_m": 0.001}, **NO_RAMP), "boundary", "back_pressure_MPa, or supply_pressure_MPa"),
        (
            changed(orifice={"back_pressure_MPa": 0.1}, inlet_temperature_K=None, **NO_RAMP),
            "", "diameter_m, or measured.pressure_MPa to fit it to, must be given",
        ),
        (changed(pressure_ramp_MPa_per_min=-20.0), "", "must lead from initial.pressure_MPa = 5 to"),
        (changed(pressure_ramp_MPa_per_min=0.0), "boundary", "must not be 0"),
        ({**FILL, "tank": {**FILL["tank"], "volume_m3": 122.0}}, "tank", "0.1224 m3, to a factor of 2; given 122 m3"),
        ({**FILL, "end_time_s": 1e9}, "end_time_s", "less than or equal to 86400; given 1000000000.0"),
        ({**FILL, "measured": []}, "measured", "valid dictionary"),
        ({**FILL, "end_time_s": None, "measured": {}}, "", "must lie between 0.01 and 86400 s; given 0"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_case(document, field, message):
    with pytest.raises(InputError) as raised:
        parse_case(document, "mine.json")
    assert raised.value.source == "mine.json"
    assert any(place == field and message in text for place, text in raised.value.problems), raised.value.problems


WORTHLESS = st.sampled_from(
    [None, 0, -1, 1e9, 1e308, 10**400, True, "x", [], {}, float("nan"), float("inf"), {"time_s": [0], "value": [1]}]
)


def places(document, path=()):
    """Every place in a document."""
    for key in document if isinstance(document, dict) else range(len(document)) if isinstance(document, list) else ():
        yield (*path, key)
        yield from places(document[key], (*path, key))


@settings(max_examples=150)
@given(st.data())
def test_a_spoilt_file_runs_or_is_an_error_of_input(data):
    document = deepcopy(FILL)
    for _ in range(data.draw(st.integers(1, 2))):
        *above, last = data.draw(st.sampled_from(list(places(document))))
        inside = document
        for key in above:
            inside = inside[key]
        inside[last] = deepcopy(data.draw(WORTHLESS))
    try:
        found = compare_case(parse_case(document, "case"), "case").gas_difference
    except InputError:
        return
    assert found is None or np.isfinite(found.largest)


def test_remarks_beside_a_boundary_are_let_pass():
    assert run(changed(note="valve half open", sources=["figure 3"])).mass[-1] == RAMP.mass[-1]


def test_gas_beyond_the_model_is_an_error():
    with pytest.raises(InputError, match=r"boundary: leads at .* s to .* MPa and .* K; the model holds up to 110 MPa"):
        run(changed(mass_flow_kg_s=0.2, **NO_RAMP))
    emptied = changed(mass_flow_kg_s=-0.2, inlet_temperature_K=None, **NO_RAMP)
    with pytest.raises(InputError, match="the model holds"):
        run(emptied)
