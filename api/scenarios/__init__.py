"""The scenarios and stations that ship with the service."""
