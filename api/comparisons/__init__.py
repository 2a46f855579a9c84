"""Comparisons: scenarios x controllers x replications, in a table."""
