"""Single runs: figures of merit and pictures."""
