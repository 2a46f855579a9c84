"""When each request arrived: from then on its patience with the store is counted."""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.store.patience import Arrival, arrival


class ArrivalMiddleware:
    """ASGI middleware; the context of a request, which its threads inherit, holds its arrival."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Note the arrival of the head, then that of the whole body."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        arrived = Arrival()
        arrival.set(arrived)  # a request is a task, and a task has a context of its own
        whole = False

        async def noting() -> Message:
            nonlocal whole
            message = await receive()
            if not whole and message["type"] == "http.request" and not message.get("more_body", False):
                whole = True
                arrived.begin()
            return message

        await self._app(scope, noting, send)
