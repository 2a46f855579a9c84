"""Shadows: stretches run again from the states of a twin, with what came; the one that acted is what happened."""

from __future__ import annotations

import pytest

from api.jobs.job_queue import JobQueue
from api.server.job_kinds import JOB_TYPES
from api.shadows.job import SHADOW
from api.shadows.service import shadow_of
from api.shadows.submitter import ShadowSubmitter
from api.store.jobs import JobRepository
from api.store.records import JobKind
from api.twins import shadow_log
from api.twins.days import DAY_S
from api.twins.schemas import TwinChange, VehicleRequest
from api.twins.shadow_schemas import ShadowRequest
from station import load_scenario, parse_scenario
from station.faults.plant import Leak
from tests.api.here import hrs
from tests.api.measured import batches, measured
from tests.api.reopened import kill, request
from tests.waiting import wait_until

ASKED = ShadowRequest(controllers=["minlp1", "reserve"], every_s=300, horizon_s=600)


class Beside:
    """What the service has beside its twins, in this thread."""

    def __init__(self, twins):
        self.twins = twins
        self.jobs = JobRepository(twins._store._database)
        queue = JobQueue(self.jobs, JOB_TYPES, 100, lambda: None, lambda: None)
        self.submitter = ShadowSubmitter(twins, self.jobs, queue, None)

    def work(self):
        """Submit what is over, and compute it."""
        self.submitter.look()
        while lease := self.jobs.claim("here", 60, 5):
            spec = self.jobs.spec(lease.job)
            self.jobs.complete(lease, SHADOW.compute(SHADOW.task(spec, lease)))

    def until(self, twin, second):
        """Work until a twin has told so many seconds and nothing of it is left to be run; it stands still then."""
        wait_until(lambda: self.twins.samples(twin) > second)
        self.twins.change(twin, TwinChange(paused=True))
        self.finish(twin)

    def finish(self, twin):
        wait_until(lambda: self.work() or not self.twins._live[twin].shadow.due)

    def found(self, twin="t", limit=200):
        return shadow_of(self.twins, self.jobs, twin, limit)


def scenario_at(station, **more):
    return parse_scenario({**load_scenario("S3").model_dump(), "station": station, **more})


def run_of(stretch, controller):
    return next(run for run in stretch.runs if run.controller == controller)


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["logic", "minlp1", "guarded"])
@pytest.mark.parametrize(
    ("station", "announced"),
    [
        pytest.param("thesis-fit", 0, marks=pytest.mark.slow), ("thesis-fit", 900),
        pytest.param("h70-light", 0, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_the_run_of_the_one_that_acted_is_what_happened(opened, station, announced, controller):
    twins = opened()
    scenario = scenario_at(station, announcement_s=announced)
    twins.start(request(scenario=scenario, controller=controller, at_end="repeat", paused=True))
    twins.set_shadow("t", ASKED)
    twins.drill("t", Leak(kind="leak", buffer="high", begin_s=500.0, end_s=900.0, rate_g_per_s=1.0))
    twins.change("t", TwinChange(paused=False))
    beside = Beside(twins)
    beside.until("t", 2000)
    found = beside.found()
    begins = [stretch.from_s for stretch in found.stretches]
    assert begins[-4:] == [1200, 900, 600, 300]
    for stretch in found.stretches:
        assert (stretch.acted, stretch.changed, stretch.error_bar) == (True, False, 0.0)
        assert [run.controller for run in stretch.runs] == list(dict.fromkeys((controller, *ASKED.controllers)))
        arrived = [run.vehicles for run in stretch.runs]
        assert arrived == arrived[:1] * len(arrived)
        assert arrived[0] > 0
    assert found.lasting in (2, 3)


@pytest.mark.slow
def test_days_are_the_sums_of_their_stretches(opened):
    twins = opened()
    twins.start(request(scenario=load_scenario("S3"), controller="logic", at_end="repeat"))
    twins.set_shadow("t", ASKED)
    beside = Beside(twins)
    beside.until("t", 6000)
    found = beside.found()
    (day,) = found.days
    assert {each.controller for each in day.sums} == {"minlp1", "reserve"}
    for each in day.sums:
        pairs = [(stretch.runs[0], run_of(stretch, each.controller)) for stretch in found.stretches]
        assert (each.stretches, each.against) == (len(pairs), ["logic"])
        assert each.better == sum(run.score_eur < acting.score_eur for acting, run in pairs)
        half = sum(acting.cost_eur - run.cost_eur for acting, run in pairs) / 2  # each second is in two stretches
        assert each.saves_eur == pytest.approx(half, abs=1e-9)
        waited = sum(run.wait_s * run.vehicles - acting.wait_s * acting.vehicles for acting, run in pairs)
        assert each.waits_s == pytest.approx(waited / sum(acting.vehicles for acting, _ in pairs), abs=1e-9)
        assert each.words.startswith(f"{each.controller} would have cost {abs(half):.2f} EUR")
        assert each.words.endswith(f"than logic; better in {each.better} of {each.stretches} stretches")
    assert [each.saves_score_eur for each in day.sums] == sorted(
        (each.saves_score_eur for each in day.sums), reverse=True
    )
    assert day.day == found.stretches[0].from_s // DAY_S


@pytest.mark.slow
def test_results_are_those_of_a_service_that_never_died(opened):
    def made(kills):
        twins = opened(f"killed{len(kills)}")
        twins.start(request(id=f"t{len(kills)}", scenario=load_scenario("S3"), at_end="repeat", paused=True))
        name = f"t{len(kills)}"
        twins.set_shadow(name, ASKED)
        for second in kills:
            twins.change(name, TwinChange(paused=False, speed=1000))
            wait_until(lambda second=second, twins=twins: twins._store.get(name).samples > second)
            Beside(twins).submitter.look()  # which is not confirmed any more
            kill(twins)
            twins = opened(f"killed{len(kills)}")
            twins.resume_all()
            assert twins.shadow_settings(name) == ASKED
        twins.change(name, TwinChange(paused=False, speed="max"))
        beside = Beside(twins)
        beside.until(name, 3000)
        runs = {stretch.from_s: stretch for stretch in beside.found(name).stretches if stretch.to_s <= 3000}
        assert sorted(runs) == list(range(300, 2401, 300))
        return {begin: (stretch.error_bar, stretch.runs) for begin, stretch in runs.items()}

    assert made([700, 1300, 1900]) == made([])


@pytest.mark.slow
def test_another_controller_that_takes_over_is_told(opened):
    twins = opened()
    twins.start(request(scenario=load_scenario("S3"), controller="logic", at_end="repeat", speed=1000))
    twins.set_shadow("t", ASKED)
    wait_until(lambda: twins.samples("t") > 1000)
    twins.add_vehicle("t", VehicleRequest(start_pressure_bar=90.0))
    twins.change("t", TwinChange(controller="minlp1"))
    at = next(event["time"] for event in twins.events("t", -1, 10_000) if event["kind"] == "controller_changed")
    beside = Beside(twins)
    beside.until("t", at + 1300)
    for stretch in beside.found().stretches:
        inside = stretch.from_s <= at <= stretch.to_s
        before = stretch.from_s <= at
        assert (stretch.changed, stretch.runs[0].controller) == (inside, "logic" if before else "minlp1")
        assert inside or stretch.error_bar == 0.0
    assert max(stretch.error_bar for stretch in beside.found().stretches) > 1.0
    twins.set_shadow("t", None)
    assert beside.found().settings is None
    (day,) = beside.found().days
    assert {each.controller: each.against for each in day.sums} == {
        "minlp1": ["logic"], "reserve": ["logic", "minlp1"],
    }  # fmt: skip
    twins.stop("t")
    twins.on_removed = beside.submitter.forget
    twins.remove("t")
    assert beside.jobs.of_twin(JobKind.SHADOW, "t", 10) == []


@pytest.mark.slow
def test_what_is_over_when_a_twin_ends_is_still_run(opened):
    twins = opened()
    twins.start(
        request(
            scenario=scenario_at("thesis-fit", arrivals={"kind": "uniform", "count": 5, "period_s": 2000.0}),
            at_end="stop",
            paused=True,
        )
    )
    twins.set_shadow("t", ASKED)
    twins.change("t", TwinChange(paused=False))
    wait_until(lambda: not twins.running("t"))
    beside = Beside(twins)
    beside.finish("t")
    assert [stretch.from_s for stretch in beside.found().stretches][-5:] == [1500, 1200, 900, 600, 300]


@pytest.mark.slow
def test_a_twin_that_nobody_can_keep_up_with_leaves_the_oldest_out(opened, monkeypatch):
    monkeypatch.setattr(shadow_log, "DUE_MAX", 10)
    twins = opened()
    twins.start(request(scenario=load_scenario("S3"), controller="logic", at_end="repeat"))
    twins.set_shadow("t", ASKED)
    wait_until(lambda: twins.samples("t") > 300 * 15)
    live = twins.live("t")
    twins.change("t", TwinChange(paused=True))
    assert len(live.shadow.due) == 10
    assert live.shadow.left_out > 0
    beside = Beside(twins)
    beside.submitter.look()
    assert len(beside.jobs.of_twin(JobKind.SHADOW, "t", 100)) == 8, "no more wait for workers at once"
    beside.finish("t")
    assert len(beside.found().stretches) == 10


def test_a_twin_that_follows_measurements_is_compared_from_its_estimates(opened):
    twins = opened()
    twins.start(measured())
    twins.set_shadow("m", ASKED.model_copy(update={"controllers": ["logic", "minlp1"], "horizon_s": 300}))
    for number, batch in enumerate(batches(720, 60)):
        twins.measure("m", "plc", number, batch)
    wait_until(lambda: twins.samples("m") > 610)
    beside = Beside(twins)
    beside.finish("m")
    found = beside.found("m")
    assert [stretch.from_s for stretch in found.stretches] == [300, 0]
    for stretch in found.stretches:
        assert (stretch.acted, stretch.error_bar) == (False, None)
        assert [run.controller for run in stretch.runs] == ["logic", "minlp1"]
        there = 4 if stretch.from_s else 3  # who is there, and who connects each 90 s
        assert [run.vehicles for run in stretch.runs] == [there] * 2


@pytest.fixture
def twin(http):
    """A live twin."""
    order = {"id": "shadowed", "scenario": "S3", "controller": "logic", "speed": 100, "at_end": "repeat"}
    http.post("/v1/twins", json=order).raise_for_status()
    yield "/v1/twins/shadowed"
    http.post("/v1/twins/shadowed/stop")
    http.delete("/v1/twins/shadowed")


@pytest.mark.slow
def test_shadows_are_asked_for_read_and_ended(http, service, twin, tmp_path):
    assert http.get(f"{twin}/shadow").json()["settings"] is None
    body = {"controllers": ["minlp1", "reserve"], "every_s": 300, "horizon_s": 300}
    put = http.put(f"{twin}/shadow", json=body)
    assert (put.status_code, put.json()["settings"]["every_s"]) == (200, 300)
    assert http.put(f"{twin}/shadow", json=body).status_code == 200
    wait_until(lambda: http.get(f"{twin}/shadow").json()["days"])
    found = http.get(f"{twin}/shadow?limit=1").json()
    assert len(found["stretches"]) == 1
    assert found["stretches"][0]["error_bar"] == 0.0
    printed = hrs("shadow", "shadowed", "--url", service.url, "--json", tmp_path / "s.json")
    assert printed.returncode == 0, printed.stderr
    assert all(text in printed.stdout for text in ("minlp1", "reserve", "better in", "a stretch of 5 min every 5 min"))
    assert hrs("shadow", "shadowed", "--controllers", "minlp1", "--stop", "--url", service.url).returncode == 2
    assert hrs("shadow", "shadowed", "--stop", "--url", service.url).returncode == 0
    ended = http.get(f"{twin}/shadow").json()
    assert (ended["settings"], bool(ended["days"])) == (None, True)
    again = hrs("shadow", "shadowed", "--controllers", "switched", "--every", 10, "--url", service.url)
    assert again.returncode == 0, again.stderr
    assert http.delete(f"{twin}/shadow").json()["settings"] is None


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"controllers": []}, "controllers"),
        ({"controllers": ["logic"] * 6}, "controllers"),
        ({"controllers": ["minlp1", "minlp1"]}, ""),
        ({"controllers": ["minlp1", "nobody"]}, "controllers.1"),
        ({"controllers": ["minlp1"], "every_s": 299}, "every_s"),
        ({"controllers": ["minlp1"], "horizon_s": 610}, "horizon_s"),
        ({"controllers": ["minlp1"], "horizon_s": 21_600, "every_s": 300}, ""),
        ({"controllers": ["minlp1"], "prices": {"unserved_eur": -1}}, "prices.unserved_eur"),
    ],
)
def test_a_wrong_request_is_refused_by_its_field(http, twin, body, field):
    refused = http.put(f"{twin}/shadow", json=body)
    assert refused.status_code == 422
    assert [each["field"] for each in refused.json()["errors"]][:1] == [field]


def test_twins_without_shadows_say_so(http, twin, measured_twin):
    assert http.get("/v1/twins/nobody/shadow").status_code == 404
    body = {"controllers": ["minlp1"]}
    assert http.put("/v1/twins/nobody/shadow", json=body).status_code == 404
    assert http.put(f"/v1/twins/{measured_twin}/shadow", json=body).json()["errors"][0]["field"] == "controllers"
    wait_until(lambda: http.get(twin).json()["samples"] > 10)
    order = {"id": "played", "source": "replay", "of": "shadowed"}
    assert http.post("/v1/twins", json=order).status_code == 201
    assert http.put("/v1/twins/played/shadow", json=body).status_code == 409
    http.post("/v1/twins/played/stop")
    http.delete("/v1/twins/played")
