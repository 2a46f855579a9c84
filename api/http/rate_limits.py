"""Rate limits: a bucket of tokens for each key, or each address where there are none."""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.http.problems import ProblemError
from api.settings import Settings, is_loopback

BUCKETS_MAX = 10_000
"""Buckets in memory, some 200 bytes each; the one that was not used for longest goes first."""


@dataclass(frozen=True, slots=True)
class RateLimitResult:
    """The result of taking a token."""

    granted: bool
    left: int  # tokens
    full_s: float  # until the bucket is full again
    next_s: float  # until there is a token


class TokenBuckets:
    """Token buckets by name: each holds `burst` tokens at most, and `per_s` flow in every second."""

    def __init__(self, per_s: float, burst: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._per_s = per_s
        self._burst = burst
        self._clock = clock
        self._tokens: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, and when [s]
        self._lock = threading.Lock()

    def take(self, name: str) -> RateLimitResult:
        """Take a token, if there is one."""
        now = self._clock()
        with self._lock:
            tokens, then = self._tokens.pop(name, (float(self._burst), now))
            tokens = min(float(self._burst), tokens + self._per_s * (now - then))
            granted = tokens >= 1.0
            if granted:
                tokens -= 1.0
            if tokens < self._burst:
                self._tokens[name] = tokens, now
            while len(self._tokens) > BUCKETS_MAX:
                self._tokens.popitem(last=False)
        return RateLimitResult(
            granted, int(tokens), (self._burst - tokens) / self._per_s, max(0.0, 1.0 - tokens) / self._per_s
        )

    def __len__(self) -> int:
        return len(self._tokens)


class RateLimiter:
    """Rate limits by the settings, one bucket for each key or address."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._buckets = TokenBuckets(settings.rate_limit_per_s, settings.rate_limit_burst)
        window = max(1, math.ceil(settings.rate_limit_burst / settings.rate_limit_per_s))
        self._policy = f'"default";q={settings.rate_limit_burst};w={window}'.encode()

    def take(self, owner: str, scope: Scope) -> RateLimitResult | None:
        """Take a token of this key's owner, or of the address; None where nothing is limited.

        Raises
        ------
        ProblemError
            if there is none.
        """
        address = (scope.get("client") or ("",))[0]
        if (
            not owner
            and is_loopback(address)
            and not (self._settings.keys_required or self._settings.rate_limit_loopback)
        ):
            return None
        taken = self._buckets.take(f"key {owner}" if owner else f"address {address}")
        if not taken.granted:
            per_s, burst = self._settings.rate_limit_per_s, self._settings.rate_limit_burst
            raise ProblemError(
                HTTPStatus.TOO_MANY_REQUESTS, "rate", "Too many requests",
                f"{per_s:g} requests a second, {burst} at once (settings rate_limit_per_s, rate_limit_burst)",
                retry_after_s=max(1, math.ceil(taken.next_s)), headers=self.headers(taken),
            )  # fmt: skip
        return taken

    def headers(self, taken: RateLimitResult) -> dict[str, str]:
        """After the IETF draft "RateLimit header fields for HTTP"."""
        told = f'"default";r={taken.left};t={math.ceil(taken.full_s)}'
        return {"RateLimit-Policy": self._policy.decode(), "RateLimit": told}


class RateLimitMiddleware:
    """ASGI middleware behind the guard, which says whose key it is."""

    def __init__(self, app: ASGIApp, limits: RateLimiter, open_to_all: Callable[[str], bool]) -> None:
        self._app = app
        self._limits = limits
        self._open = open_to_all

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through for a token, or answer 429."""
        if scope["type"] != "http" or self._open(scope["path"]):
            await self._app(scope, receive, send)
            return
        try:
            taken = self._limits.take(scope.get("hrs_owner", ""), scope)
        except ProblemError as error:
            await error.response()(scope, receive, send)
            return
        if taken is None:
            await self._app(scope, receive, send)
            return
        told = [(name.lower().encode(), value.encode()) for name, value in self._limits.headers(taken).items()]

        async def telling(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *told]
            await send(message)

        await self._app(scope, receive, telling)
