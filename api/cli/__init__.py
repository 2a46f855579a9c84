"""The command line `hrs`."""
