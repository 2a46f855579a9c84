"""Commands to live twins: which controllers are held against the one that acts."""

from __future__ import annotations

from concurrent.futures import Future

from api.http.problems import conflict
from api.twins.drills import TwinDrills
from api.twins.durable import ask
from api.twins.schemas import Source
from api.twins.shadow_schemas import ShadowRequest


class TwinShadows(TwinDrills):
    """Shadows of live twins."""

    def set_shadow(self, twin_id: str, settings: ShadowRequest | None) -> None:
        """Hold these controllers against the one that acts, or none; stretches that last begin anew with others.

        Raises
        ------
        NotYet
            if that is not stored within 2 s.
        ProblemError
            409 where the twin has ended, is a replay or runs elsewhere.
        """
        twin = self._alive(twin_id)
        if twin.request.source is Source.REPLAY:
            raise conflict(f"twin {twin_id!r} plays a stretch of another again: that one has shadows")

        def change() -> Future[None]:
            twin.set_shadow(settings)
            return twin.store_with()

        self._wait_for(ask(twin, change))

    def shadow_settings(self, twin_id: str) -> ShadowRequest | None:
        """Which controllers are held against the one that acts; None where none is. A problem if there is no twin."""
        given = self._now(twin_id).get("shadow")
        return None if given is None else ShadowRequest.model_validate(given)
