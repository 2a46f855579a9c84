"""`hrs opcua serve` as clients see it, which are asyncua's and not ours."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from datetime import datetime, timedelta

import pytest
from asyncua import Client, ua

from api.bridges.opcua.endpoint import Endpoint
from api.bridges.opcua.server import TwinServer
from api.client import Service
from api.twins.messages import sample_columns
from station import StationError
from tests.api.bridges.opcua.conftest import Serving
from tests.api.conftest import RunningService
from tests.api.test_alarms import with_rules
from tests.waiting import awaited, wait_until


def at_server(url, act):
    """What an act with a client of a server comes to."""

    async def connected():
        async with Client(url, timeout=20, watchdog_intervall=20) as client:
            return await act(client)

    return awaited(connected())


def node(client, name):
    return client.get_node(f"ns=2;s={name}")


def columns_of(twin):
    """Names of a twin's columns."""
    return list(sample_columns(twin.state()["layout"]))


def second_of(twin, moment):
    """The second of a twin whose time a simulation gives."""
    return (moment - datetime.fromisoformat(twin.state()["created"])).total_seconds()


def paused_at(service, name, seconds, **order):
    """A twin that stands still after some seconds at least."""
    twin = service.start("S1", id=name, speed=1000, at_end="idle", **order)
    wait_until(lambda: twin.state()["samples"] > seconds)
    twin.change(paused=True)
    return twin


@pytest.mark.slow
def test_a_twin_is_shown_with_units_times_and_history_and_is_not_written(service, serving):
    twin = paused_at(service, "shown", 150)
    history, state = twin.history(), twin.state()
    seconds = history["time"]

    async def look(client):
        assert (await client.get_namespace_array())[2] == "urn:hrs-twin:twins"
        names = {(await child.read_browse_name()).Name for child in await node(client, "shown").get_children()}
        assert names == {*columns_of(twin), "state"}
        shown = ("pressure_high", "outlet_high", "vehicle")
        pressure, valve, vehicle = (node(client, f"shown.{name}") for name in shown)
        while (told := await pressure.read_data_value(raise_on_bad_status=False)).Value.Value is None:
            await asyncio.sleep(0.05)
        assert told.StatusCode.is_good()
        assert told.Value.Value == state["values"]["pressure_high"]
        assert second_of(twin, told.SourceTimestamp) == seconds[-1]
        assert isinstance((await valve.read_data_value()).Value.Value, bool)
        assert (await vehicle.read_data_type_as_variant_type()) == ua.VariantType.Int32
        unit = await (await pressure.get_child("0:EngineeringUnits")).read_value()
        assert (unit.DisplayName.Text, unit.UnitId) == ("bar", 4342098)
        limits = await (await pressure.get_child("0:EURange")).read_value()
        assert limits.Low == 0.0 < limits.High
        assert await pressure.read_type_definition() == ua.NodeId(ua.ObjectIds.AnalogItemType)
        assert await node(client, "shown.state").read_value() == "paused"
        for refused in (pressure.write_value(1.0), node(client, "shown").add_variable(2, "mine", 1.0)):
            with pytest.raises(ua.UaStatusCodeError, match=r"BadUserAccessDenied|BadNotWritable|not authorized"):
                await refused
        for name in ("pressure_high", "outlet_high", "mass_vehicle"):
            found = await node(client, f"shown.{name}").read_raw_history(
                told.SourceTimestamp - timedelta(days=1), told.SourceTimestamp
            )
            assert [second_of(twin, each.SourceTimestamp) for each in found] == seconds.tolist()
            values = [None if figure != figure else figure for figure in history[name].tolist()]
            assert [each.Value.Value for each in found] == values
            assert [each.StatusCode.is_good() for each in found] == [value is not None for value in values]
        newest = await pressure.read_raw_history(None, told.SourceTimestamp, numvalues=3)
        assert [each.Value.Value for each in newest] == history["pressure_high"][-1:-4:-1].tolist()
        backwards = await pressure.read_raw_history(told.SourceTimestamp, told.SourceTimestamp - timedelta(seconds=9.5))
        assert [each.Value.Value for each in backwards] == history["pressure_high"][-1:-11:-1].tolist()

    at_server(serving("shown").url, look)
    twin.stop()


async def read_raw(client, name, *, point=None, **details):
    """The answer to one HistoryRead."""
    asked = {"IsReadModified": False, "NumValuesPerNode": 0, "ReturnBounds": False, **details}
    nothing = {"StartTime": ua.get_win_epoch(), "EndTime": ua.get_win_epoch()}
    return await node(client, name).history_read(ua.ReadRawModifiedDetails(**{**nothing, **asked}), point)


@pytest.mark.slow
def test_pages_of_history_follow_one_another_and_what_is_wrong_is_refused(service, serving):
    twin = paused_at(service, "pages", 100)
    pressures = twin.history(["pressure_high"])["pressure_high"].tolist()
    begin = datetime.fromisoformat(twin.state()["created"])
    span = {"StartTime": begin, "EndTime": begin + timedelta(seconds=len(pressures))}

    async def look(client):
        found, point, pages = [], None, 0
        while pages == 0 or point:
            page = await read_raw(client, "pages.pressure_high", point=point, NumValuesPerNode=30, **span)
            found += [each.Value.Value for each in page.HistoryData.DataValues]
            point, pages = page.ContinuationPoint, pages + 1
        assert found == pressures
        assert pages == -(-len(pressures) // 30)
        empty = await read_raw(
            client, "pages.pressure_high", StartTime=begin - timedelta(hours=2), EndTime=begin - timedelta(hours=1)
        )
        assert (empty.StatusCode.is_good(), empty.HistoryData.DataValues) == (True, [])
        codes = ua.StatusCodes
        for answer, code in (
            (read_raw(client, "pages.pressure_high"), codes.BadHistoryOperationInvalid),
            (read_raw(client, "pages.pressure_high", EndTime=begin), codes.BadHistoryOperationInvalid),
            (read_raw(client, "pages.pressure_high", point=b"?", **span), codes.BadContinuationPointInvalid),
            (read_raw(client, "pages.state", **span), codes.BadHistoryOperationUnsupported),
            (read_raw(client, "pages.nothing", **span), codes.BadHistoryOperationUnsupported),
            (read_raw(client, "pages.pressure_high", **{**span, "IsReadModified": True}),
             codes.BadHistoryOperationUnsupported),
        ):  # fmt: skip
            assert (await answer).StatusCode.value == code

    at_server(serving("pages").url, look)
    twin.stop()


class Heard:
    """The events and changes that a subscription hears."""

    def __init__(self) -> None:
        self.events, self.changes = [], []

    def event_notification(self, event):
        self.events.append(event)

    def datachange_notification(self, node, value, data):
        self.changes.append((node.nodeid.Identifier, data.monitored_item.Value))


async def until(condition, seconds=60.0):
    """As `wait_until`, and the loop goes on."""
    async with asyncio.timeout(seconds):
        while not condition():
            await asyncio.sleep(0.02)


@pytest.mark.slow
def test_alarms_are_events_with_their_states(service, serving):
    twin = service.start(with_rules(), id="alarmed", speed=1000, at_end="idle")
    wait_until(lambda: twin.state()["samples"] > 200)
    twin.change(paused=True)
    raised = twin.alarms()["items"][0]["raised_s"]
    serve = serving("alarmed")

    async def look(client):
        heard = Heard()
        subscription = await client.create_subscription(50, heard)
        alarm_type = client.get_node(ua.ObjectIds.AlarmConditionType)
        await subscription.subscribe_alarms_and_conditions(node(client, "alarmed"), alarm_type)
        await asyncio.to_thread(twin.act_on_alarm, "early", "acknowledge")
        await until(lambda: heard.events)
        acknowledged = heard.events[-1]
        assert acknowledged.ConditionName == "early"
        assert (acknowledged.SourceName, acknowledged.Severity, acknowledged.ClientUserId) == ("alarmed", 900, "local")
        assert acknowledged.Message.Text == "It is so (acknowledged)"
        assert second_of(twin, acknowledged.Time) >= raised
        states = [getattr(acknowledged, f"{name}/Id") for name in ("ActiveState", "AckedState", "SuppressedState")]
        assert (states, acknowledged.Retain, acknowledged.SuppressedOrShelved) == ([True, True, False], True, False)
        await asyncio.to_thread(twin.act_on_alarm, "early", "out_of_service", reason="a new sensor")
        await until(lambda: len(heard.events) == 2)
        aside = heard.events[-1]
        assert (aside.Comment.Text, aside.SuppressedOrShelved) == ("a new sensor", True)
        assert (getattr(aside, "OutOfServiceState/Id"), getattr(aside, "ActiveState/Id")) == (True, True)
        refreshed = Heard()
        every = await client.create_subscription(50, refreshed)
        await every.subscribe_alarms_and_conditions(evtypes=alarm_type)
        condition = client.get_node(ua.ObjectIds.ConditionType)
        asked = ua.Variant(every.subscription_id, ua.VariantType.UInt32)
        await condition.call_method(ua.NodeId(ua.ObjectIds.ConditionType_ConditionRefresh), asked)
        await until(lambda: any(getattr(event, "ConditionName", "") == "early" for event in refreshed.events))

    at_server(serve.url, look)
    twin.stop()


def follow_twins(service, serving, names, seconds):
    """Twins at ten seconds a second: every change is seen, and a server that was killed has history without a hole."""
    twins = [service.start("S1", id=name, speed=10, at_end="repeat", seed=5) for name in names]
    serve = serving(",".join(names))
    columns = columns_of(twins[0])

    async def hear(client):
        heard = Heard()
        subscription = await client.create_subscription(100, heard)
        every = ua.DataChangeFilter(Trigger=ua.DataChangeTrigger.StatusValueTimestamp)
        asked = [ua.NodeId(f"{name}.{column}", 2) for name in names for column in columns]
        items = [
            ua.MonitoredItemCreateRequest(
                ItemToMonitor=ua.ReadValueId(NodeId=node_id, AttributeId=ua.AttributeIds.Value),
                MonitoringMode=ua.MonitoringMode.Reporting,
                RequestedParameters=ua.MonitoringParameters(ClientHandle=number, Filter=every, QueueSize=100),
            )
            for number, node_id in enumerate(asked, 1)
        ]
        await subscription.create_monitored_items(items)
        await until(lambda: len(heard.changes) > len(items) * seconds, 120)
        return heard.changes

    changes = at_server(serve.url, hear)
    for name, twin in zip(names, twins, strict=True):
        for column in columns:
            told = [value for node, value in changes if node == f"{name}.{column}"]
            numbers = [round(second_of(twin, value.SourceTimestamp)) for value in told if value.SourceTimestamp]
            assert numbers == list(range(numbers[0], numbers[-1] + 1)), (name, column)
    serve.kill()
    before = twins[0].state()["samples"]
    wait_until(lambda: twins[0].state()["samples"] > before + 10)
    serve.start()
    for twin in twins:
        twin.change(paused=True)

    async def read(client):
        for name, twin in zip(names, twins, strict=True):
            history = await asyncio.to_thread(twin.history)
            begin = datetime.fromisoformat(twin.state()["created"])
            for column in columns:
                end = begin + timedelta(seconds=len(history) - 1)
                found = await node(client, f"{name}.{column}").read_raw_history(begin, end)
                expected = [None if figure != figure else figure for figure in history[column].tolist()]
                assert [value.Value.Value for value in found] == expected, (name, column)

    at_server(serve.url, read)
    for twin in twins:
        twin.stop()


@pytest.mark.slow
def test_every_change_of_a_twin_is_seen_and_a_kill_leaves_no_hole(service, serving):
    follow_twins(service, serving, ["seen"], 20)


@pytest.mark.full
def test_60_nodes_at_10_hz_are_seen_and_a_kill_leaves_no_hole(service, serving):
    follow_twins(service, serving, ["one", "two"], 200)


@pytest.mark.full
def test_values_of_a_service_that_is_away_are_uncertain(tmp_path):
    running = RunningService(tmp_path / "data", "--workers", "0", HRS_CHECKPOINT_S="1")
    with Service(url=running.url) as service:
        twin = service.start("S1", id="away", speed=10, at_end="repeat")
        serve = Serving(running, "away")

        async def look(client):
            pressure = node(client, "away.pressure_high")

            async def status():
                return (await pressure.read_data_value(raise_on_bad_status=False)).StatusCode

            while not (await status()).is_good():
                await asyncio.sleep(0.05)
            known = (await pressure.read_data_value()).SourceTimestamp
            running.kill()
            while (await status()).value != ua.StatusCodes.UncertainNoCommunicationLastUsableValue:
                await asyncio.sleep(0.05)
            answer = await read_raw(client, "away.pressure_high", StartTime=known - timedelta(seconds=5), EndTime=known)
            assert answer.StatusCode.value == ua.StatusCodes.BadNoCommunication
            await asyncio.to_thread(running.start)
            while not (await status()).is_good():
                await asyncio.sleep(0.05)
            await asyncio.to_thread(twin.stop)
            while (await status()).value != ua.StatusCodes.UncertainLastUsableValue:
                await asyncio.sleep(0.05)
            assert await node(client, "away.state").read_value() == "stopped"
            found = await pressure.read_raw_history(known - timedelta(seconds=2), known)
            assert len(found) == 3

        at_server(serve.url, look)
        serve.stop()
    running.stop()


def test_a_twin_that_is_not_there_is_named(service, running):
    endpoint = Endpoint.parse("--endpoint", "opc.tcp://127.0.0.1:4840")
    with pytest.raises(StationError, match="nobody"):
        TwinServer(service, ["nobody"], endpoint, None, running.url)


FIRST_HISTORY = """
import sys
import pyarrow
from pyarrow import parquet
from api.bridges.opcua import history, server
from api.client.series import Series

history.prepare()
loaded = set(sys.modules)
written = pyarrow.BufferOutputStream()
parquet.write_table(pyarrow.table({"time": [0.0, 1.0]}), written)
Series(written.getvalue().to_pybytes())["time"]
assert not set(sys.modules) - loaded, sorted(set(sys.modules) - loaded)
assert "pandas" in loaded, "or nothing would have to be prepared"
"""


def test_the_first_history_loads_no_library_while_clients_wait():
    done = subprocess.run([sys.executable, "-c", FIRST_HISTORY], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
