"""Faults of a station that are known to be there: of the plant, of a sensor, of a clock; with time and size.

Those of the plant change what happens (`PlantFaults`), the others what is measured (`station.measured_day`). Each has
the name by which `station.estimation.detection` would tell it, so that detection can be scored.
"""
