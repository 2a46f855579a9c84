"""Forecasts of live twins: answered at once or as jobs, kept, and held against what came."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from station import load_scenario
from station.plants.thesis import gas_pressure
from tests.api.conftest import ended
from tests.api.measured import batches, rows
from tests.waiting import wait_until

HRS = Path(sys.executable).with_name("hrs")


@pytest.fixture
def twin(http):
    """A live twin some minutes on, which stands still."""
    http.post(
        "/v1/twins", json={"id": "next", "scenario": "S3", "controller": "logic", "speed": 1000, "at_end": "repeat"}
    ).raise_for_status()
    wait_until(lambda: http.get("/v1/twins/next").json()["samples"] > 900)
    http.patch("/v1/twins/next", json={"paused": True}).raise_for_status()
    yield "next"
    http.post("/v1/twins/next/stop")
    http.delete("/v1/twins/next")


def _asked(http, twin, **more):
    return http.post(f"/v1/twins/{twin}/forecasts", json={"controllers": ["minlp1"], "futures": 20, **more})


@pytest.mark.slow
def test_a_forecast_is_answered_kept_and_held_against_what_came(http, twin):
    made = _asked(http, twin)
    assert made.status_code in (200, 202)
    found = ended(http, made.headers["location"])
    answer = found["answer"]
    assert [each["controller"] for each in answer["controllers"]] == found["names"] == ["logic", "minlp1"]
    assert answer["time_s"] == [found["begin_s"] + 60.0 * place for place in range(61)]
    for each in answer["controllers"]:
        assert all(band["low"] <= band["median"] <= band["high"] for band in each["figures"].values())
        for band in each["pressures"].values():
            assert all(low <= high for low, high in zip(band["low"], band["high"], strict=True))
    assert {each["controller"] for each in answer["ranking"]} == {"logic", "minlp1"}
    assert "in 1 h" in answer["advice"] or "for 1 h" in answer["advice"]
    assert found["came"] is None
    http.patch(f"/v1/twins/{twin}", json={"paused": False}).raise_for_status()
    wait_until(lambda: http.get(f"/v1/twins/{twin}").json()["samples"] > found["begin_s"] + 3700)
    came = http.get(made.headers["location"]).json()["came"]
    assert (came["until_s"], came["changed"]) == (found["begin_s"] + 3600, False)
    assert 0 <= came["covered"] <= 1
    http.patch(f"/v1/twins/{twin}", json={"controller": "reserve"}).raise_for_status()
    assert http.get(made.headers["location"]).json()["came"]["changed"] is False  # it was over by then
    listed = http.get("/v1/forecasts").json()["items"]
    assert [(each["id"], each["answer"]) for each in listed if each["id"] == found["id"]] == [(found["id"], None)]
    assert http.delete(made.headers["location"]).status_code == 204
    assert http.get(made.headers["location"]).status_code == 404


@pytest.mark.slow
def test_a_key_and_a_seed_give_the_same_forecast(http, twin):
    key = {"Idempotency-Key": "forecast-1"}
    body = {"controllers": ["logic"], "futures": 5, "seed": 3}
    path = f"/v1/twins/{twin}/forecasts"
    first, again = (http.post(path, json=body, headers=key) for _ in range(2))
    assert first.headers["location"] == again.headers["location"]
    other = http.post(path, json=body)
    answers = [ended(http, each.headers["location"])["answer"] for each in (first, other)]
    assert answers[0] == answers[1]


def test_vehicles_that_are_announced_come_in_every_future(http, twin):
    announced = [{"in_s": 60.0 * place, "start_pressure_bar": 100.0} for place in range(1, 4)]
    made = _asked(http, twin, arrivals="announced", announced=announced, controllers=["logic"], futures=3)
    with_them = ended(http, made.headers["location"])["answer"]["controllers"][0]["figures"]["vehicles"]
    made = _asked(http, twin, arrivals="announced", controllers=["logic"], futures=3)
    without = ended(http, made.headers["location"])["answer"]["controllers"][0]["figures"]["vehicles"]
    assert (with_them["low"], with_them["high"]) == (without["low"] + 3, without["high"] + 3)


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"controllers": []}, "controllers"),
        ({"controllers": ["nobody"]}, "controllers.0"),
        ({"controllers": ["logic", "minlp1:horizon=99"]}, "controllers.1"),
        ({"horizon_s": 90}, "horizon_s"),
        ({"futures": 0}, "futures"),
        ({"futures": True}, "futures"),
        ({"arrivals": "none"}, "arrivals"),
        ({"arrivals": "learned", "law": "S1"}, ""),
        ({"law": "nothing"}, "law"),
        ({"futures": 2000, "horizon_s": 86_400}, ""),
        ({"announced": [{"in_s": 60, "start_pressure_bar": 699.0, "finish_pressure_bar": 350.0}]},
         "announced.0.start_pressure_bar"),
        ({"announced": [{"in_s": 4000, "start_pressure_bar": 100.0}]}, ""),
        ({"prices": {"waiting_eur_per_h": -1}}, "prices.waiting_eur_per_h"),
    ],
)  # fmt: skip
def test_a_wrong_question_is_refused_by_its_field(http, twin, body, field):
    refused = _asked(http, twin, **body)
    assert refused.status_code == 422
    assert [each["field"] for each in refused.json()["errors"]] == [field]


def test_a_twin_that_is_not_there_or_has_followed_nothing_is_refused(http, measured_twin):
    assert _asked(http, "nobody").status_code == 404
    assert _asked(http, measured_twin).status_code == 409


@pytest.mark.slow
def test_a_twin_that_follows_measurements_is_forecast_from_its_estimates(http, measured_twin):
    path = f"/v1/twins/{measured_twin}"
    for number, batch in enumerate(batches(180, 30)):
        query = {"source": "plc", "sequence": number}
        assert http.post(f"{path}/measurements", params=query, json=rows(batch)).status_code == 202
    wait_until(lambda: http.get(f"{path}/estimate").json().get("number") == 6)
    estimate = http.get(f"{path}/estimate").json()
    for arrivals in ("law", "learned"):
        made = _asked(http, measured_twin, controllers=["logic", "minlp1"], arrivals=arrivals)
        assert made.status_code in (200, 202), made.text
        found = ended(http, made.headers["location"])
        assert found["names"] == ["logic", "minlp1"]
        assert found["begin_s"] == estimate["seq"] + 1  # the second that comes next
        high = found["answer"]["controllers"][0]["pressures"]["high"]
        mass, kelvin = (estimate["quantities"][f"{name}_high"]["value"] for name in ("mass", "temperature"))
        volume = load_scenario("S1").station.buffers.high.volume_m3
        assert high["median"][0] == pytest.approx(gas_pressure(mass, kelvin, volume), rel=0.01)
        assert high["low"][0] < high["median"][0] < high["high"][0]  # it is not known exactly


@pytest.mark.slow
def test_hrs_forecast_prints_a_row_a_controller(http, service, twin, tmp_path):
    done = subprocess.run(
        [HRS, "forecast", twin, "--controllers", "minlp1,reserve", "--futures", "10", "--url", service.url, "--json",
         tmp_path / "f.json"],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert all(
        name in done.stdout for name in ("logic", "minlp1", "reserve", "wait [s]", "cost [EUR]", "of 10 futures")
    )
    assert (tmp_path / "f.json").read_text().startswith("{")
