"""The store of the service: the only room that speaks SQL."""
