"""Names of this room, imported when they are first asked for: `lazy_loader` reads this file."""

from .registry import controllers as controllers
from .slot import DeadlineController as DeadlineController
from .slot import create as create
from .slot import create_from as create_from
