"""The face: command line, comparisons, reports."""
