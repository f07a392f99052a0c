"""Recorded runs: reading them into numpy, checking and mending them."""
