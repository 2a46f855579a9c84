"""The alarms of a station: seconds and commands in, changes of state out; it goes on from a snapshot."""

from __future__ import annotations

import hashlib
import json
import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.alarm_rules import Priority, alarms_of
from station.alarm_signals import SIGNALS
from station.alarms.figures import RAISES_MAX, AlarmFigures, alarm_figures
from station.alarms.kernel import AlarmMemory, AlarmPlan, advance, alarm_memory
from station.alarms.states import ANNOUNCED, Alarm, AlarmState
from station.archives import refuse_other_shapes
from station.entry_points import EntryPoint
from station.errors import InputError
from station.geometry import BUFFERS
from station.limit_figures import limit_figures
from station.parameters import Station

Floats = NDArray[np.float64]

SHELVE_MAX_S = 7 * 86_400.0
"""An alarm is put aside for at most so long [s]; one that is to stay so is taken out of service."""

_KERNEL = "alarm_kernel_"
"""Before the names of the kernel's arrays in a snapshot."""


class Transition(NamedTuple):
    """A change of an alarm's state."""

    time: float  # [s]
    details: dict[str, Any]  # as an event tells it


def _transition(time: float, alarm: Alarm, before: AlarmState) -> Transition:
    rule = alarm.rule
    details = {
        "alarm": rule.name, "title": rule.title, "priority": str(rule.priority), "state": str(alarm.state),
        "before": str(before), "signal": rule.signal, "value": alarm.value, "limit": rule.limit, "unit": rule.unit,
        "raised_s": alarm.raised,
    }  # fmt: skip
    if alarm.by:
        details |= {"by": alarm.by, "reason": alarm.reason}
    if alarm.shelved_until is not None:
        details["shelved_until_s"] = alarm.shelved_until
    return Transition(time, details)


class AlarmSystem:
    """The alarms of one station.

    Parameters
    ----------
    station : Station
        Whose table of rules it has, or the one that ships, and whose limits.
    """

    def __init__(self, station: Station) -> None:
        rules = alarms_of(station.alarms)
        self.alarms = {rule.name: Alarm(rule) for rule in rules}
        self._listed = list(self.alarms.values())
        self._effects: dict[str, list[Alarm]] = {}  # alarms that are a consequence of one
        for alarm in self._listed:
            for cause in alarm.rule.suppressed_by:
                self._effects.setdefault(cause, []).append(alarm)
        limits = limit_figures(station)
        finish = station.vehicle.finish_pressure_bar + limits.outlet_gap_min
        temperatures = [limits.buffer_temperature_max] * len(BUFFERS) + [limits.vehicle_temperature_max]
        self._plan = AlarmPlan(
            np.array([SIGNALS.index(rule.signal) for rule in rules], np.int64),
            np.array([1.0 if rule.above is not None else -1.0 for rule in rules]),
            np.array([rule.limit for rule in rules]),
            np.array([rule.deadband for rule in rules]),
            np.array([rule.on_delay_s for rule in rules]),
            np.array([rule.off_delay_s for rule in rules]),
            np.array([*temperatures, *station.bank_pressures_max, finish]),
        )
        given = json.dumps([rule.model_dump(mode="json") for rule in rules])
        self._table = hashlib.sha256(given.encode()).hexdigest()
        self._memory = alarm_memory(len(rules))
        self._raises: deque[tuple[float, int]] = deque(maxlen=RAISES_MAX)
        self._delays: deque[float] = deque(maxlen=RAISES_MAX)  # from a begin to its acknowledgement [s]
        self._begun = self._time = 0.0
        self._shelf_ends = math.inf  # when the first one comes back from the shelf [s]
        self._advance: Callable[..., int] = EntryPoint(advance)
        self._one = np.zeros((1, len(rules)), np.int8), np.zeros((1, len(rules)))

    # Seconds.

    def advance(self, times: Floats, inputs: Floats) -> list[Transition]:
        """Look at seconds, (n,) [s] and (n, len(INPUTS)); the changes of state in them, in order."""
        if not len(times):
            return []
        self._time = float(times[-1])
        if len(times) == 1:
            changed, values = self._one
        else:
            changed, values = (
                np.zeros((len(times), len(self._listed)), np.int8),
                np.zeros((len(times), len(self._listed))),
            )
        count = self._advance(times, inputs, self._plan, self._memory, changed, values)
        if not count and self._time < self._shelf_ends:
            return []
        rows = np.flatnonzero(changed.any(axis=1)).tolist() if count else []
        told: list[Transition] = []
        while (row := min([*rows[:1], int(np.searchsorted(times, self._shelf_ends))])) < len(times):
            time = float(times[row])
            self._take_from_the_shelf(time)
            if rows[:1] == [row]:
                for k in np.flatnonzero(changed[row]).tolist():
                    self._condition(k, time, float(values[row, k]), begins=changed[row, k] > 0)
                rows.pop(0)
            told += self._settled(time)
        return told

    def silence(self, age: float) -> list[Transition]:
        """Nothing has been measured for so long by the wall clock [s], and no second comes: what that begins."""
        place = SIGNALS.index("data_age")
        for k in np.flatnonzero(self._plan.signal == place).tolist():
            beyond = self._plan.sign[k] * (age - self._plan.limit[k])
            if not self._memory.active[k] and beyond > 0.0 and age >= self._plan.limit[k] + self._plan.on_delay[k]:
                self._memory.active[k], self._memory.since[k] = 1.0, np.nan
                self._condition(k, self._time, age, begins=True)
        return self._settled(self._time)

    def _condition(self, k: int, time: float, value: float, *, begins: bool) -> None:
        alarm = self._listed[k]
        if not begins:
            alarm.end(time, value)
            return
        alarm.suppressed = self._is_suppressed(alarm)
        alarm.begin(time, value)
        if alarm.pending:
            self._raises.append((time, k))

    def _is_suppressed(self, alarm: Alarm) -> bool:
        return any(self.alarms[cause].active for cause in alarm.rule.suppressed_by)

    def _settled(self, time: float) -> list[Transition]:
        """Causes and their consequences; then every change of state since the last look."""
        for k, alarm in enumerate(self._listed):
            suppressed = self._is_suppressed(alarm)
            if suppressed != alarm.suppressed:
                alarm.suppressed = suppressed
                if suppressed:
                    alarm.aside()
                else:
                    self._back(k, alarm, time)
        found = []
        for alarm in self._listed:
            before = alarm.told
            if alarm.state is not before:
                alarm.told = alarm.state
                found.append(_transition(time, alarm, before))
        return found

    def _back(self, k: int, alarm: Alarm, time: float) -> None:
        alarm.back()
        if alarm.pending:
            self._raises.append((time, k))

    def _take_from_the_shelf(self, time: float) -> None:
        if time < self._shelf_ends:
            return
        for k, alarm in enumerate(self._listed):
            if alarm.shelved_until is not None and alarm.shelved_until <= time:
                alarm.shelved_until = None
                self._back(k, alarm, time)
        self._shelf_ends = self._first_end()

    def _first_end(self) -> float:
        return min((each.shelved_until for each in self._listed if each.shelved_until is not None), default=math.inf)

    # Commands.

    def acknowledge(self, name: str, by: str, raised: float | None = None) -> list[Transition]:
        """Acknowledge an alarm; nothing changes where that was done before.

        Parameters
        ----------
        name
            Of the alarm.
        by
            Who has seen it.
        raised
            Begin of the condition that was seen [s]; left out: the last.

        Raises
        ------
        InputError
            if there is none of that name, or its condition has begun again since.
        """
        alarm = self._alarm(name)
        if raised is not None and raised != alarm.raised:
            since = "has not begun" if alarm.raised is None else f"began at {alarm.raised:g} s"
            raise InputError(
                "alarm", [("raised_s", f"must be when {name!r} began last, which {since}; given {raised:g}")]
            )
        if not alarm.pending:
            return []
        alarm.pending, alarm.by, alarm.reason = False, by, ""
        if alarm.raised is not None:
            self._delays.append(max(0.0, self._time - alarm.raised))
        return self._settled(self._time)

    def shelve(self, name: str, for_s: float, by: str, reason: str) -> list[Transition]:
        """Put an alarm aside for so long [s].

        Raises
        ------
        InputError
            if there is none of that name, it is out of service, or that is longer than SHELVE_MAX_S.
        """
        alarm = self._alarm(name)
        if alarm.out_of_service:
            raise InputError("alarm", [("action", f"{name!r} is out of service: it cannot be shelved")])
        if not 0 < for_s <= SHELVE_MAX_S:
            raise InputError("alarm", [("for_s", f"must be above 0 and at most {SHELVE_MAX_S:g} s; given {for_s:g}")])
        alarm.shelved_until, alarm.by, alarm.reason = self._time + for_s, by, reason
        alarm.aside()
        self._shelf_ends = self._first_end()
        return self._settled(self._time)

    def unshelve(self, name: str, by: str) -> list[Transition]:
        """Take an alarm back from the shelf before its time; nothing changes where it is not there.

        Raises
        ------
        InputError
            if there is none of that name.
        """
        alarm = self._alarm(name)
        if alarm.shelved_until is None:
            return []
        alarm.shelved_until, alarm.by, alarm.reason = None, by, ""
        self._shelf_ends = self._first_end()
        return self._back_in_service(alarm)

    def take_out(self, name: str, by: str, reason: str) -> list[Transition]:
        """Take an alarm out of service until somebody puts it back; nothing changes where it is out.

        Raises
        ------
        InputError
            if there is none of that name.
        """
        alarm = self._alarm(name)
        if alarm.out_of_service:
            return []
        alarm.out_of_service, alarm.shelved_until, alarm.by, alarm.reason = True, None, by, reason
        alarm.aside()
        self._shelf_ends = self._first_end()
        return self._settled(self._time)

    def put_back(self, name: str, by: str) -> list[Transition]:
        """Put an alarm back into service; nothing changes where it is.

        Raises
        ------
        InputError
            if there is none of that name.
        """
        alarm = self._alarm(name)
        if not alarm.out_of_service:
            return []
        alarm.out_of_service, alarm.by, alarm.reason = False, by, ""
        return self._back_in_service(alarm)

    def _back_in_service(self, alarm: Alarm) -> list[Transition]:
        self._back(self._listed.index(alarm), alarm, self._time)
        return self._settled(self._time)

    def _alarm(self, name: str) -> Alarm:
        alarm = self.alarms.get(name)
        if alarm is None:
            raise InputError("alarm", [("name", f"no alarm of this station is called {name!r}")])
        return alarm

    # What is known of it.

    @property
    def announced(self) -> list[Alarm]:
        """The alarms that are shown, the most urgent first."""
        return [alarm for alarm in self.ordered if alarm.state in ANNOUNCED]

    @property
    def ordered(self) -> list[Alarm]:
        """Every alarm: those that are shown first, by priority, those nobody has acknowledged before the others."""
        urgency = list(Priority)
        return sorted(
            self._listed,
            key=lambda alarm: (
                alarm.state not in ANNOUNCED, urgency.index(alarm.rule.priority), not alarm.pending,
                -(alarm.raised if alarm.raised is not None else -math.inf),
            ),
        )  # fmt: skip

    def figures(self) -> AlarmFigures:
        """The alarm system's own figures, of its last day."""
        return alarm_figures(self._listed, self._raises, self._delays, self._begun, self._time)

    def memories(self) -> dict[str, np.ndarray]:
        """Arrays for a snapshot, by name."""
        kept = {alarm.rule.name: alarm.kept() for alarm in self._listed if not alarm.is_fresh}
        document = {"table": self._table, "alarms": kept, "begun": self._begun, "time": self._time}
        text = json.dumps(document, separators=(",", ":"))
        return {
            "alarms": np.frombuffer(text.encode(), np.uint8),
            "alarm_raises": np.array(self._raises, float).reshape(-1, 2),
            "alarm_delays": np.array(self._delays, float),
            **{_KERNEL + name: array.copy() for name, array in self._memory._asdict().items()},
        }

    def resume(self, memories: dict[str, Any]) -> None:
        """Go on from a snapshot; from one without alarms they begin now.

        Of a table that has changed the alarms that are still there keep what people did with them.

        Raises
        ------
        InputError
            naming what no such system could have written.
        """
        if "alarms" not in memories:
            return
        try:
            kept = json.loads(bytes(memories["alarms"]).decode())
            known = {name: given for name, given in kept["alarms"].items() if name in self.alarms}
            for name, given in known.items():
                self.alarms[name].resume(given)
            self._begun, self._time = float(kept["begun"]), float(kept["time"])
        except (ValueError, KeyError, TypeError) as error:
            raise InputError("snapshot", [("alarms", f"cannot be read: {error!s:.200}")]) from None
        self._shelf_ends = self._first_end()
        if kept["table"] != self._table:
            self._memory.active[:] = [alarm.active for alarm in self._listed]  # other rules count delays anew
            return
        found = {name: memories.get(_KERNEL + name) for name in AlarmMemory._fields}
        refuse_other_shapes({name: each for name, each in found.items() if each is not None}, self._memory._asdict())
        self._memory = AlarmMemory._make(np.array(found[name]) for name in AlarmMemory._fields)
        raises = np.asarray(memories["alarm_raises"], float).reshape(-1, 2)
        self._raises.extend((time, int(k)) for time, k in raises.tolist() if 0 <= k < len(self._listed))
        self._delays.extend(np.asarray(memories["alarm_delays"], float).ravel().tolist())
