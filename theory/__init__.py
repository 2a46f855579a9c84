"""The mathematics: certificates of switched systems, predictive control without a model, paths among obstacles."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
