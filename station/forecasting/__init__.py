"""Forecasts: a station's state now, forked into futures that all controllers share."""
