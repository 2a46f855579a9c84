"""Predictive control of unknown linear systems (chapter 5): sets of models, tubes around them, Algorithm 1."""
