"""Gymnasium environments of a station, `hrs/Station-v0`, one or many at a time; the extra `gym` installs Gymnasium.

Importing this room makes them known to Gymnasium. Where it is not installed policies still run (`policy`).
"""

from __future__ import annotations

from importlib.util import find_spec

ID = "hrs/Station-v0"
"""Under which Gymnasium knows the environment."""

if find_spec("gymnasium") is not None:
    from gymnasium.envs.registration import register

    register(
        id=ID,
        entry_point=f"{__name__}.station_env:StationEnv",
        vector_entry_point=f"{__name__}.vector_env:StationVectorEnv",
    )
