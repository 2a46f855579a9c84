"""Twins as things of the Web of Things (W3C), described in the terms of their REST routes and zenoh keys."""
