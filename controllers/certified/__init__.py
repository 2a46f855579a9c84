"""What is proved of controllers at a station."""
