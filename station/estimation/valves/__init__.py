"""Valves that stick: found by meters and pressures, and taken for what they are."""
