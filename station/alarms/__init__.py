"""Alarms in the manner of ISA-18.2 and IEC 62682: rules, the signals that they watch, and the life of an alarm."""
