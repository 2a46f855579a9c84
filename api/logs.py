"""The service's log: one line an event, as text or as JSON, with the request it belongs to and without secrets."""

from __future__ import annotations

import json
import logging
import re
import sys
from contextvars import ContextVar
from typing import Literal

from api.moments import written

LogFormat = Literal["text", "json"]

request_id: ContextVar[str] = ContextVar("request_id", default="")
"""Id of the request that is being answered; empty outside of one."""

_SECRETS = (
    (re.compile(r"hrs_[A-Za-z0-9_-]{16,}"), "hrs_***"),  # our keys
    (re.compile(r"(://[^/\s:@]*):[^\s@/]*@"), r"\1:***@"),  # a password in an address
    (re.compile(r"(?i)\b(authorization\W{1,4})?(bearer|basic) +[^\s\"',]+"), r"\1\2 ***"),
    (re.compile(r"(?i)\b(password\s*=\s*)\S+"), r"\1***"),
)
"""Patterns that never stand in a line, and what stands there instead."""


def redacted(text: str) -> str:
    """The text without keys, passwords and credentials."""
    for pattern, instead in _SECRETS:
        text = pattern.sub(instead, text)
    return text


class TextFormatter(logging.Formatter):
    """The message for people, and the id of its request."""

    def format(self, record: logging.LogRecord) -> str:
        """One event; a traceback goes on in further lines."""
        line = super().format(record)
        asked = request_id.get()
        return redacted(f"{line} [request {asked}]" if asked else line)


class JsonFormatter(logging.Formatter):
    """One JSON object a line for programs; `extra={"fields": {...}}` adds members."""

    def format(self, record: logging.LogRecord) -> str:
        """One event; a traceback is the member `exception`."""
        event = {
            "time": written(record.created, "milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if asked := request_id.get():
            event["request_id"] = asked
        event.update(getattr(record, "fields", {}))
        if record.exc_info:
            event["exception"] = self.formatException(record.exc_info)
        return redacted(json.dumps(event, ensure_ascii=False, default=str))


def configure(log_format: LogFormat, level: int = logging.INFO) -> None:
    """Write every event of this process to stderr in this format."""
    root = logging.getLogger()
    if not root.handlers:
        root.addHandler(logging.StreamHandler(sys.stderr))
        root.setLevel(level)
    for handler in root.handlers:
        handler.setFormatter(JsonFormatter() if log_format == "json" else TextFormatter("%(message)s"))
    if log_format == "json":
        logging.captureWarnings(capture=True)
