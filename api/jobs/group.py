"""Imported first by the fork server, and by it alone: it outlives a SIGTERM that is sent to the whole group.

Otherwise it would end before the server that was asked to stop, which would take its workers for dead and say so.
"""

from __future__ import annotations

import signal

signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends with the server, whose end of a pipe it watches
