"""The service's log: one line an event, as text or as JSON, with the request it belongs to and without secrets."""

from __future__ import annotations

import logging
import re
import sys
from typing import TYPE_CHECKING, Any, Literal

from api.moments import written

if TYPE_CHECKING:
    from structlog.typing import EventDict, Processor

LogFormat = Literal["text", "json"]

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


def configure(log_format: LogFormat, level: int = logging.INFO) -> None:
    """Write every event of this process to stderr in this format.

    As JSON, members that a call of `logging` gives as `extra` are members of the line.
    """
    from structlog.stdlib import ProcessorFormatter

    root = logging.getLogger()
    if not root.handlers:
        root.addHandler(logging.StreamHandler(sys.stderr))
        root.setLevel(level)
    for handler in root.handlers:
        handler.setFormatter(ProcessorFormatter(processors=_processors(log_format)))
    if log_format == "json":
        logging.captureWarnings(capture=True)


def _processors(log_format: LogFormat) -> list[Processor]:
    """Steps from an event to its line; secrets are struck out of the line as it is written."""
    from structlog.processors import EventRenamer, JSONRenderer, format_exc_info
    from structlog.stdlib import ExtraAdder, ProcessorFormatter, add_log_level, add_logger_name

    if log_format == "text":
        return [_add_request_id, format_exc_info, _render_text, _redact]
    return [
        _add_time, add_log_level, add_logger_name, EventRenamer("message"), _add_request_id, ExtraAdder(),
        ProcessorFormatter.remove_processors_meta, format_exc_info,
        JSONRenderer(ensure_ascii=False, default=str), _redact,
    ]  # fmt: skip


def _add_time(_logger: object, _level: str, event: EventDict) -> EventDict:
    event["time"] = written(event["_record"].created, "milliseconds")
    return event


def _add_request_id(_logger: object, _level: str, event: EventDict) -> EventDict:
    from asgi_correlation_id.context import correlation_id

    if request_id := correlation_id.get():
        event["request_id"] = request_id
    return event


def _render_text(_logger: object, _level: str, event: EventDict) -> str:
    """The message for people, and the id of its request; a traceback goes on in further lines."""
    line = f"{event['event']}\n{event['exception']}" if "exception" in event else event["event"]
    return f"{line} [request {event['request_id']}]" if "request_id" in event else line


def _redact(_logger: object, _level: str, line: Any) -> str:  # structlog's type of a step knows no line
    return redacted(line)
