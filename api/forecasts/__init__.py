"""Forecasts: what a live twin's station will do under each of several controllers, and which of them to take."""
