"""Switched systems (chapters 3 and 4): languages, their graphs, one theorem family a file, certificates."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
