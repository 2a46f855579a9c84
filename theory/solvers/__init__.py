"""Convex programs: the only room that imports Clarabel and DAQP."""
