"""Live telemetry over zenoh: the only room that speaks it."""
