"""The client against a running service: jobs, series bit for bit, live twins through a crash, and errors by name."""

from __future__ import annotations

import subprocess
import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from api.client import JobError, Service, ServiceError, Twin
from api.client.series import MissingLibraryError
from controllers import create
from station import InputError, load_scenario, parse_scenario, simulate
from station.metrics import UNITS
from tests.api.conftest import RunningService

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples" / "clients"


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """A service with one worker."""
    started = RunningService(tmp_path_factory.mktemp("client"), "--workers", "1")
    yield started
    started.stop()


@pytest.fixture
def service(running):
    """Its client."""
    with Service(url=running.url) as client:
        yield client


def test_a_run_has_the_figures_and_the_bits_of_simulate(service):
    run = service.run("S1", "minlp1", replication=2, seed=3).wait()
    record = simulate(load_scenario("S1"), create("minlp1"), replication=2, seed=3)
    assert run.metrics == {name: record.metrics()[name] for name in record.metrics()}
    series = run.series()
    assert set(series.numpy()) == set(record.columns)
    assert series.units == record.columns
    for name, column in series.numpy().items():
        assert column.tobytes() == record[name].tobytes(), name
        assert column.dtype == record[name].dtype
    some = run.series(["pressure_high"], from_s=100, to_s=700, step_s=300)
    assert some["time"].tolist() == [100.0, 400.0, 700.0]
    assert some["pressure_high"].tolist() == record["pressure_high"][[100, 400, 700]].tolist()
    assert len(run.series(["queue_length"], step_s=600, extremes=True)) % 2 == 0
    assert run.vehicles()["arrival"].tolist() == record.vehicles["arrival"].tolist()
    assert [each.id for each in service.runs()][:1] == [run.id]


def test_pandas_and_polars_have_what_numpy_has(service, monkeypatch):
    series = service.run(load_scenario("S1")).wait().series(["pressure_vehicle", "outlet_high"])
    frame, table = series.pandas(), series.polars()
    assert frame.attrs["units"] == series.units == {"time": "s", "pressure_vehicle": "bar", "outlet_high": "1"}
    assert list(frame.columns) == table.columns == list(series.numpy())
    for name, column in series.numpy().items():
        assert frame[name].to_numpy().tobytes() == table[name].to_numpy().tobytes() == column.tobytes()
    with pytest.raises(KeyError, match="no column 'pressure'; there are time, pressure_vehicle, outlet_high"):
        series["pressure"]
    for library, ask in (("pandas", series.pandas), ("polars", series.polars)):
        monkeypatch.setitem(sys.modules, library, None)
        with pytest.raises(MissingLibraryError, match=r"pip install hrs-twin\[notebook\]"):
            ask()


def test_a_comparison_is_awaited_and_read(service):
    rush = {"name": "rush", "arrivals": {"kind": "poisson", "rate_per_h": 20, "period_s": 900}}
    told = []
    comparison = service.compare(["S1", rush], ["logic", "minlp1"], replications=2, seed=1).wait(told.append)
    assert told[-1]["runs_done"] == 8
    results = comparison.results()
    assert results.units["t_total"] == UNITS["t_total"]
    rows = list(zip(results["scenario"], results["controller"], results["replication"], strict=True))
    assert len(set(rows)) == len(rows) == 8
    expected = simulate(parse_scenario(rush), create("logic"), replication=1, seed=1).metrics().t_total
    assert results["t_total"][rows.index(("rush", "logic", 1))] == expected
    assert [table["title"] for table in comparison.tables()["tables"]]
    assert "<html" in comparison.report()
    assert comparison.figures()
    assert comparison.id in [each.id for each in service.comparisons()]
    comparison.delete()
    with pytest.raises(ServiceError, match=r"no comparison"):
        comparison.refresh()


def test_a_job_that_does_not_succeed_says_so(service):
    run = service.run("S4", "minlp1:horizon=9:engine=pyomo")
    run.cancel()
    with pytest.raises(JobError, match=f"{run.id} cancelled"):
        run.wait()


def test_wrong_input_is_told_by_its_fields(service):
    with pytest.raises(InputError) as caught:
        service.run("S9", "logic", seed=-1)
    assert {field for field, _ in caught.value.problems} >= {"seed"}
    with pytest.raises(ServiceError, match="no twin"):
        service.twin("nobody").state()
    with pytest.raises(ServiceError, match="no twin"):
        next(service.twin("nobody").samples())


@pytest.mark.slow
def test_a_twin_is_operated_and_read(service):
    twin = service.start("S1", id="mine", at_end="idle", speed=100, seed=2)
    assert "mine" in [each.id for each in service.twins()]
    twin.change(controller="minlp1", speed=50)
    state = twin.add_vehicle(120.0, finish_pressure_bar=690.0)
    assert (state["controller"], state["speed"]) == ("minlp1", 50)
    twin.drill(kind="leak", buffer="low", rate_g_per_s=1.0, begin_s=1e6)
    assert [each["event"] for each in twin.drills()["items"]] == ["leak_low"]
    assert twin.act_on_alarm("twin_late", "shelve", for_s=60.0, reason="a slow machine")["state"] == "shelved"
    assert "twin_late" in [each["name"] for each in twin.alarms()["items"]]
    found = twin.forecast(["logic"], horizon_s=600, futures=4).wait()
    assert [each["controller"] for each in found.answer["ranking"]]
    twin.stop()
    kinds = [event["kind"] for event in twin.events()]
    assert kinds[0] == "started"
    assert {"controller_changed", "speed_changed", "vehicle_added", "stopped"} <= set(kinds)
    assert [event["seq"] for event in twin.events(after=2)] == list(range(3, len(kinds)))
    history = twin.history(["pressure_high"])
    assert history["time"].tolist() == list(range(len(history)))
    assert np.isfinite(history["pressure_high"]).all()
    newest = twin.history(["pressure_high"], last_s=3)
    assert newest["pressure_high"].tolist() == history["pressure_high"][-3:].tolist()
    assert twin.days()[0]["day"] == 0
    twin.delete()


def test_numbers_of_numpy_are_sent_and_what_json_has_not_is_named(service):
    day = {"name": "day", "arrivals": {"kind": "uniform", "count": np.int64(2), "period_s": np.float64(600)}}
    run = service.run(day, "logic", seed=np.uint8(3)).wait()
    assert run.metrics["vehicles"] == 2
    day["arrivals"]["period_s"] = np.float64("nan")
    day["station"] = {"name": "odd", "about": object()}
    with pytest.raises(InputError) as caught:
        service.run(day, "logic")
    [first, second] = caught.value.problems
    assert first == ("scenario.arrivals.period_s", "must be a finite number; given nan")
    assert second[0] == "scenario.station.about"


@pytest.mark.slow
def test_samples_go_on_through_a_crash_and_end_with_the_twin(running, service):
    twin = Twin("steady", service)
    service.start("S1", id="steady", at_end="repeat", speed=5)
    samples = twin.samples()
    before = list(islice(samples, 5))
    assert [each.missed for each in before] == [0] * 5
    running.kill()
    running.start()
    after = list(islice(samples, 5))
    assert after[0].epoch == before[-1].epoch + 1
    numbers = [each.seq for each in after]
    assert numbers == list(range(numbers[0], numbers[0] + 5))
    assert all(each.time == each.seq == each.values["time"] for each in before + after)
    twin.stop()
    assert len(list(samples)) < 50  # what was told before it was stopped, and then the end
    twin.delete()


@pytest.mark.slow
@pytest.mark.parametrize("script", ["with_client.py", "with_httpx.py"])
def test_an_example_runs(running, script):
    done = subprocess.run(
        [sys.executable, EXAMPLES / script, running.url], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "compressor 1517 s" in done.stdout
    assert "rush minlp1" in done.stdout
