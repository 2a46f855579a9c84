"""Shadows of live twins: what controllers beside the one that acts would have made of what came."""
