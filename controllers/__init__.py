"""The slot, and the controllers that can sit in it."""

from controllers.registry import controllers
from controllers.slot import Deadline, create, create_from

__all__ = ["Deadline", "controllers", "create", "create_from"]
