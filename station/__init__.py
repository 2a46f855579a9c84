"""The plant: one second of a hydrogen refueling station, and everything that is true of it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
