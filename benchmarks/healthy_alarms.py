"""Alarms of healthy days: `python -m benchmarks.healthy_alarms [--station h70-light] [--days 30]`.

Every one of them is false, but for those of waits and gas, which tell of the day. Stations are drawn as
`benchmarks.following` draws them, each calibrated from a day by `logic`, or followed with a file so many percent off
(`--off`), and followed as a measured twin follows, in the air of that program, by each controller in turn.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter

from benchmarks.following import CONTROLLERS, DAY, WIDTH, day_of, played
from benchmarks.measured_forecasts import drawn_station, measured
from station import Record, Station, load_station
from station.alarm_rules import Priority
from station.alarms.states import AlarmState
from station.alarms.system import AlarmSystem
from station.batches import batches_of
from station.estimation.alarm_inputs import inputs_of
from station.estimation.calibration import calibrate
from station.estimation.followed import FollowedRun
from station.measured_day import measured_day, tags_of_day

SPOKEN = (Priority.HIGH, Priority.MEDIUM)
"""Of these there is to be at most one in thirty days."""


BATCH_S = 60.0
"""Measurements come so many seconds at a time [s]; what is told does not depend on it."""


def known_of(preset: str, seed: int, off: float | None) -> tuple[Station, Station | None]:
    """A drawn station, and it as it is known; None where its calibration is refused."""
    if off is not None:
        hidden = drawn_station(preset, seed, off / WIDTH)
        return hidden, load_station(preset).model_copy(update={"calibrated": True})
    hidden = drawn_station(preset, seed)
    found = calibrate(measured(played(day_of(hidden, DAY), "logic", seed), seed), load_station(preset))
    if found.station is None or found.refused:
        return hidden, None
    return hidden, found.station.model_copy(update={"calibrated": True})


def alarms_of(record: Record, known: Station, seed: int) -> list[tuple[Priority, str, float]]:
    """Alarms that a followed record raises: priority, name and time [s]."""
    tags = tags_of_day()
    run, system, raised = FollowedRun(known, tags), AlarmSystem(known), []
    for batch in batches_of(measured_day(record, seed), tags, BATCH_S):
        found = run.push(batch)
        for told in system.advance(found.time, inputs_of(found)):
            if told.details["state"] == AlarmState.UNACKNOWLEDGED:
                raised.append((Priority(told.details["priority"]), told.details["alarm"], told.time))
                system.acknowledge(told.details["alarm"], "benchmark")
    return raised


def main() -> None:
    """Parse the arguments, print alarms by priority; status 1 where more than one in thirty days is spoken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--station", default="thesis-fit")
    parser.add_argument("--days", type=int, default=30)
    parser.add_argument("--each", type=int, default=3, help="days of each station")
    parser.add_argument("--seed", type=int, default=1, help="of the first station")
    parser.add_argument("--off", type=float, help="follow with a file so many percent off, not calibrated")
    asked = parser.parse_args()
    count: Counter[tuple[str, str]] = Counter()
    days, seed = 0, asked.seed
    while days < asked.days:
        hidden, known = known_of(asked.station, seed, asked.off)
        seed += 1
        if known is None:
            print(f"station {seed - 1}: calibration refused", flush=True)
            continue
        for draw in range(100 * seed, 100 * seed + asked.each):
            controller = CONTROLLERS[days % len(CONTROLLERS)]
            for priority, name, time in alarms_of(played(day_of(hidden, DAY), controller, draw), known, draw):
                count[priority, name] += 1
                if priority in SPOKEN:
                    print(f"station {seed - 1}, {controller}, {time:.0f} s: {name} ({priority})", flush=True)
            days += 1
    for priority in Priority:
        told = {name: number for (each, name), number in sorted(count.items()) if each == priority}
        print(f"{asked.station}, {days} days, {priority}: {told or 'none'}", flush=True)
    sys.exit(int(30 * sum(number for (each, _), number in count.items() if each in SPOKEN) > days))


if __name__ == "__main__":
    main()
