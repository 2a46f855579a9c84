"""The controllers that are installed."""
