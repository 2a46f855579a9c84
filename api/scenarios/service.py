"""Scenarios that have a name: those that ship with the service, and those that users store in it."""

from __future__ import annotations

import difflib
import hashlib
import json
import re
import time
from collections.abc import Callable
from functools import cache
from http import HTTPStatus
from typing import Annotated

from fastapi import Depends
from pydantic import ValidationError

from api.http.dependencies import provided
from api.http.etags import Preconditions, digest_of
from api.http.problems import ProblemError, conflict, in_json, invalid, not_found
from api.moments import moment
from api.scenarios.schemas import NAME_PATTERN, Origin, ScenarioSummary
from api.settings import Settings
from api.store.records import StoredScenario
from api.store.scenarios import ScenarioRepository
from station import InputError, Scenario, load_scenario, scenarios

ABOUT_MAX = 200
"""Characters of a description that a list shows: the document may hold megabytes of them."""

LISTED = 10
"""Names of users' scenarios that are shown where one is not found."""

_RESERVED = {"resolve", "vehicles", "trace"}
"""Parts of other paths below /v1/scenarios."""


class Scenarios:
    """Scenarios by name."""

    def __init__(
        self, store: ScenarioRepository, settings: Settings, check_room: Callable[[], None] = lambda: None
    ) -> None:
        self._store = store
        self._settings = settings
        self._check_room = check_room  # raises where the store takes nothing new

    def summaries(self) -> list[ScenarioSummary]:
        """Those that ship, then those of users, each by name."""
        return [*_shipped(), *(_own(stored) for stored in self._store.all())]

    def get(self, name: str) -> tuple[Scenario, str]:
        """A scenario and its tag; a problem if there is none."""
        found = self._find(name)
        if found is None:
            raise not_found("scenario", name, [*scenarios(), *self._stored(name)])
        return found

    def resolve(self, given: Scenario | str, field: str = "scenario") -> Scenario:
        """The scenario itself, for a name as well.

        Raises
        ------
        InputError
            naming `field`, if none is called so.
        """
        if isinstance(given, Scenario):
            return given
        found = self._find(given)
        if found is None:
            known = ", ".join(self._near(given))
            raise InputError("request", [(field, f"no scenario is called {given!r:.80}; there are {known}")])
        return found[0]

    def put(self, name: str, scenario: Scenario, conditions: Preconditions) -> tuple[str, bool]:
        """Store a scenario under its name; its tag, and whether there was none of that name.

        Raises
        ------
        ProblemError
            for a name that ships or is no name, a document that is too large, or conditions that do not hold.
        Full, StoreFull
            if there are as many as the settings allow, or the store takes nothing new.
        """
        _check_name(name)
        self._check_room()
        if scenario.name != name:
            raise invalid([("name", f"must be {in_json(name)}, as in the path; given {in_json(scenario.name):.80}")])
        document = scenario.model_dump(mode="json", exclude_none=True)
        text = json.dumps(document, sort_keys=True).encode()
        if len(text) > self._settings.scenario_bytes_max:
            limit = f"{self._settings.scenario_bytes_max} bytes (setting scenario_bytes_max)"
            raise ProblemError(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "body-too-large", "Body too large",
                f"a stored scenario must not exceed {limit}; given {len(text)} with every parameter filled in",
            )  # fmt: skip
        about = {
            "about": scenario.about[:ABOUT_MAX], "station": scenario.station.name,
            "vehicles": len(scenario.vehicles().arrival), "time_limit_s": scenario.time_limit_s,
        }  # fmt: skip
        wanted = StoredScenario(name, about, hashlib.sha256(text).hexdigest(), time.time())
        made = self._store.put(wanted, document, self._settings.scenarios_max, _checked(name, conditions))
        return _tag(wanted), made

    def remove(self, name: str, conditions: Preconditions) -> None:
        """Forget a user's scenario; jobs and twins keep theirs.

        Raises
        ------
        ProblemError
            if there is none of that name, it ships, or conditions do not hold.
        """
        _check_changeable(name)
        if not self._store.remove(name, _checked(name, conditions)):
            raise not_found("stored scenario", name, self._stored(name) or ["none"])

    def _find(self, name: str) -> tuple[Scenario, str] | None:
        if name in scenarios():
            return load_scenario(name), digest_of("shipped", name)
        found = self._store.get(name) if re.fullmatch(NAME_PATTERN, name) else None
        if found is None:
            return None
        try:
            return Scenario.model_validate(found[1]), _tag(found[0])
        except ValidationError as error:
            wrong = InputError.of("by this version's limits", error)
            raise conflict(f"scenario {name!r} was stored by another version, and is wrong {wrong}") from None

    def _stored(self, name: str) -> list[str]:
        """Names of users' scenarios, those that are spelt nearly so first, and how many more there are."""
        own = [stored.name for stored in self._store.all()]
        near = difflib.get_close_matches(name, own, LISTED, 0.0)
        left = len(own) - LISTED
        return [*near, f"{left} more"] if left > 0 else near

    def _near(self, name: str) -> list[str]:
        """Names to be shown where one is not found: those that ship, and users' that are spelt nearly so."""
        own = [stored.name for stored in self._store.all()]
        return [*scenarios(), *difflib.get_close_matches(name, own)]


ScenariosDep = Annotated[Scenarios, Depends(provided(Scenarios))]


def _checked(name: str, conditions: Preconditions) -> Callable[[StoredScenario | None], None]:
    return lambda held: conditions.check(f"scenario {name!r}", None if held is None else _tag(held))


def _check_name(name: str) -> None:
    _check_changeable(name)
    if name in _RESERVED or not re.fullmatch(NAME_PATTERN, name):
        what = "must have 1 to 64 letters, digits, - and _, and begin with a letter or digit"
        reserved = ", ".join(sorted(_RESERVED))
        raise invalid([("name", f"{what}; {reserved} are taken by other paths; given {name!r:.80}")])


def _check_changeable(name: str) -> None:
    if name.lower() in {shipped.lower() for shipped in scenarios()}:
        raise conflict(f"scenario {name!r} ships with the service and cannot be changed; take another name")


@cache
def _shipped() -> list[ScenarioSummary]:
    found = [load_scenario(name) for name in scenarios()]
    return [
        ScenarioSummary(
            name=scenario.name, about=scenario.about, station=scenario.station.name,
            vehicles=len(scenario.vehicles().arrival), time_limit_s=scenario.time_limit_s,
        )
        for scenario in found
    ]  # fmt: skip


def _own(stored: StoredScenario) -> ScenarioSummary:
    return ScenarioSummary(name=stored.name, **stored.about, origin=Origin.OWN, changed=moment(stored.changed))


def _tag(stored: StoredScenario) -> str:
    return digest_of("own", stored.name, stored.digest)
