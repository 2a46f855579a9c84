"""A listener for twins under test."""

from __future__ import annotations


class Ear:
    """A listener that notes what it hears."""

    def __init__(self):
        self.samples, self.events, self.lives = [], [], []

    def opened(self, twin):
        self.lives.append(f"+{twin}")

    def closed(self, twin):
        self.lives.append(f"-{twin}")

    def sample(self, sample):
        self.samples.append(sample)

    def event(self, event):
        self.events.append(event)
