"""Measurements as senders write them, and as the log keeps them."""
