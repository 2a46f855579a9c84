"""Estimation of a station: its only inputs are measurements, a plant and its parameters."""
