"""FMI: the plant of a station as a Functional Mock-up Unit for co-simulation, 2.0 or 3.0."""
