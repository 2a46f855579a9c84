"""/v1/keys: make, list, revoke."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Path, Response

from api.http.authorization import requires
from api.http.bodies import JsonRoute
from api.http.dependencies import KeysDep, SettingsDep
from api.http.problems import not_found
from api.keys.schemas import KeyRequest, KeySummary, NewKey, ZenohLogin
from api.scopes import Scope
from api.store.records import Key
from api.telemetry.access import Login, read_secret

router = APIRouter(prefix="/v1/keys", tags=["keys"], route_class=JsonRoute)


@router.post("", status_code=201)
@requires(Scope.ADMIN)
def create_key(request: KeyRequest, keys: KeysDep, settings: SettingsDep) -> NewKey:
    """Make a key; it is told this once and stored as a digest."""
    key = keys.create(request.name, request.scopes)
    made = next(each for each in keys.all() if each.name == request.name)
    zenoh = None
    if settings.zenoh_keys_required:
        login = Login.of(made, read_secret(settings))
        zenoh = ZenohLogin(user=login.user, password=login.password)
    return NewKey(key=key, zenoh=zenoh, **_shown(made).model_dump())


@router.get("")
@requires(Scope.ADMIN)
def list_keys(keys: KeysDep) -> list[KeySummary]:
    """Every key there is or was, the oldest first."""
    return [_shown(key) for key in keys.all()]


@router.delete("/{name}", status_code=204)
@requires(Scope.ADMIN)
def revoke_key(
    name: Annotated[str, Path(max_length=64, description="Whose key it is", examples=["ann"])], keys: KeysDep
) -> Response:
    """Refuse a key from now on."""
    if not keys.revoke(name):
        raise not_found("valid key", name)
    return Response(status_code=204)


def _shown(key: Key) -> KeySummary:
    return KeySummary(
        name=key.name, scopes=list(key.scopes), created=datetime.fromtimestamp(key.created, UTC),
        revoked=None if key.revoked is None else datetime.fromtimestamp(key.revoked, UTC),
    )  # fmt: skip
