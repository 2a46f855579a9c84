"""Paths among obstacles under random disturbances (chapter 6): free boxes, scenario programs, Algorithm 2."""
