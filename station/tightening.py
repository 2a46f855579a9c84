"""Constraint tightening: a station whose limits are moved by their margins, and whether it still serves vehicles."""

from __future__ import annotations

from station.limits import buffer_temperature_margin, vehicle_temperature_margin
from station.margins import Proof, certify, covered_limits
from station.parameters import Station
from station.plants.thesis import gas_pressure
from station.uncertainty import Uncertainty


class TightenedStation(Station):
    """A station as controllers know it in a disturbed scenario: limits moved by their margins, its uncertainty."""

    uncertainty: Uncertainty
    nominal: Station


def tightened(station: Station, proof: Proof) -> TightenedStation:
    """The station as the shield and the controllers know it: every limit moved by its margin.

    A margin function with the moved limit is that margin function less its entry in `Proof.margins`. The flow law of
    this station has the moved compressor pressure.
    """
    margins, constants = proof.margins, station.constants()
    parts: dict[str, dict[str, float]] = {}
    for limit in covered_limits(constants):
        if limit.figure is not None:
            part, field, sign = limit.figure
            moved = getattr(getattr(station, part), field) + sign * margins[limit.name]
            parts.setdefault(part, {})[field] = moved
    return TightenedStation.model_construct(
        **{
            **{name: getattr(station, name) for name in Station.model_fields},
            **{part: getattr(station, part).model_copy(update=moved) for part, moved in parts.items()},
            "uncertainty": proof.uncertainty,
            "nominal": station,
        }
    )


def check_serves(station: Station, uncertainty: Uncertainty, finish: float) -> None:
    """Raise ValueError where the margins could keep a vehicle from `finish` [bar] for ever.

    Whatever the errors, an outlet must open at some pressures that the compressor is sure to reach, and valves must
    open at ambient temperature.
    """
    known = tightened(station, certify(station, uncertainty)).constants()
    error, warm = uncertainty.pressure_bar, known.ambient_temperature + 2 * uncertainty.temperature_k
    highest = known.compressor_pressure - error - known.limits.outlet_gap_min - 2 * error
    if finish >= highest:
        raise ValueError(
            f"disturbance.uncertainty.pressure_bar: with errors of {error:g} bar no vehicle is sure to reach "
            f"{highest:.6g} bar; its finish pressure is {finish:g}"
        )
    flow_max = known.limits.dispenser_flow_max
    if flow_max < known.outlet_coefficient * (known.limits.outlet_gap_min + 4 * error):
        raise ValueError(
            f"disturbance.uncertainty: dispenser.flow_max_g_per_s less its margin is {flow_max:.6g} "
            f"g/s; the flow at outlet_gap_min_bar with its margin is not below it, so no outlet is sure to open"
        )
    cold = [buffer_temperature_margin(buffer, 0.0, warm, known, 1.0) for buffer in range(3)]
    if min(*cold, vehicle_temperature_margin(warm, known, 1.0)) < 0:
        raise ValueError(
            f"disturbance.uncertainty.temperature_k: valves stay closed at ambient temperature; "
            f"given {uncertainty.temperature_k:g} K"
        )
    most = known.outlet_coefficient * (1 + uncertainty.parameters)
    least = station.vehicle.volume_m3 * (1 - uncertainty.parameters)
    share = most * float(gas_pressure(1.0, station.vehicle.temperature_max_c + 2 * uncertainty.temperature_k, least))
    if share >= 1:
        raise ValueError(
            f"disturbance.uncertainty.parameters: a second could move {share:.3g} times the pressure difference "
            f"between buffer and vehicle, the limit is 1; given {uncertainty.parameters:g}"
        )
