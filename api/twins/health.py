"""What an estimate says of a station's health, and about which quantities it says nothing."""

from __future__ import annotations

from collections.abc import Collection, Mapping

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
    quantities: Mapping[str, EstimatedQuantity], seq: int, *, refused: bool = False, scale: float = 1.0,
    unknown_buffers: Collection[str] = (),
) -> dict[str, Verdict]:  # fmt: skip
    """The verdict on each leak, each factor and a precooler at second `seq`, by the limits of detection.

    Unknown where the model is refused: what a model that does not fit takes for a leak is none. So are leaks of
    `unknown_buffers`, whose volumes nobody knows. `scale` multiplies the limit of leaks.
    """
    unsure = {f"leak_{buffer}" for buffer in unknown_buffers}
    return {
        name: Verdict.UNKNOWN if refused or name in unsure else _verdict(each, name, seq, scale)
        for name, each in quantities.items()
        if name.startswith("leak_") or name.endswith("_factor") or name == PRECOOLER
    }


def unknown_in(
    quantities: Mapping[str, EstimatedQuantity], seq: int, *, refused: bool = False, scale: float = 1.0,
    unknown_buffers: Collection[str] = (),
) -> list[str]:  # fmt: skip
    """Names of the quantities whose deviation is so large that nothing is known of them; see `health_of`.

    Masses of `unknown_buffers` among them: they are as far off as the volumes.
    """
    health = health_of(quantities, seq, refused=refused, scale=scale, unknown_buffers=unknown_buffers)
    unsure = {f"mass_{buffer}" for buffer in unknown_buffers}
    return [
        name
        for name, each in quantities.items()
        if name in unsure or (health[name] is Verdict.UNKNOWN if name in health else not _is_known(each, name))
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
