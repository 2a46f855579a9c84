"""MINLP 1, 2 and 3 of chapter 7: one objective, three sets of weights, three engines."""

from controllers.minlp.controller import Minlp, Minlp1, Minlp2, Minlp3

__all__ = ["Minlp", "Minlp1", "Minlp2", "Minlp3"]
