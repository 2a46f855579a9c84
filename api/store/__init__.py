"""What the service keeps: the only room that speaks SQL."""
