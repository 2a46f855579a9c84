"""The slot, and the controllers that can sit in it."""

from controllers.slot import Deadline, controllers, create, create_from

__all__ = ["Deadline", "controllers", "create", "create_from"]
