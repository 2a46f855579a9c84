"""What an estimate says of a station's health, and about which quantities it says nothing."""

from __future__ import annotations

from collections.abc import Mapping

from api.twins.measurement_schemas import EstimatedQuantity, Verdict
from station.estimation.detection_memory import FACTOR_LIMIT, LEAK_LIMIT, SETTLING, SIGNIFICANT, WARMER_LIMIT

WIDTH = 2.0
"""Standard deviations on either side within which a quantity lies [1]."""

MASS_KNOWN = 0.5
"""A mass is not known where WIDTH deviations are a larger part of it [1]."""

PRECOOLER = "precooler_deviation"
"""By how much warmer than it should be a precooler is, of a plant that has one."""

KELVIN_KNOWN = 10.0
"""A temperature is not known where WIDTH deviations are more [K]."""


def health_of(
    quantities: Mapping[str, EstimatedQuantity], seq: int, *, refused: bool = False, scale: float = 1.0
) -> dict[str, Verdict]:
    """The verdict on each leak, each factor and a precooler at second `seq`, by the limits of detection.

    Unknown where the model is refused: what a model that does not fit takes for a leak is none. `scale` multiplies
    the limit of leaks.
    """
    return {
        name: Verdict.UNKNOWN if refused else _verdict(each, name, seq, scale)
        for name, each in quantities.items()
        if name.startswith("leak_") or name.endswith("_factor") or name == PRECOOLER
    }


def unknown_in(
    quantities: Mapping[str, EstimatedQuantity], seq: int, *, refused: bool = False, scale: float = 1.0
) -> list[str]:
    """Names of the quantities whose deviation is so large that nothing is known of them; see `health_of`."""
    health = health_of(quantities, seq, refused=refused, scale=scale)
    return [
        name
        for name, each in quantities.items()
        if (health[name] is Verdict.UNKNOWN if name in health else not _is_known(each, name))
    ]


def _verdict(each: EstimatedQuantity, name: str, seq: int, scale: float) -> Verdict:
    """Unknown where a loss at the limit could not be told from none."""
    if each.value is None or each.deviation is None or seq < SETTLING:
        return Verdict.UNKNOWN
    if name == PRECOOLER:
        loss, limit = each.value, WARMER_LIMIT
    elif name.startswith("leak_"):
        loss, limit = each.value, scale * LEAK_LIMIT
    else:
        loss, limit = 1.0 - each.value, 1.0 - FACTOR_LIMIT
    if loss > limit and loss > SIGNIFICANT * each.deviation:
        return Verdict.FAILING
    return Verdict.UNKNOWN if WIDTH * each.deviation > limit else Verdict.SOUND


def _is_known(each: EstimatedQuantity, name: str) -> bool:
    """Whether a quantity is known; of a vehicle that is not there, nothing is to be known."""
    if each.value is None or each.deviation is None:
        return name.endswith("_vehicle")
    limit = MASS_KNOWN * abs(each.value) if name.startswith("mass_") else KELVIN_KNOWN
    return WIDTH * each.deviation <= limit
