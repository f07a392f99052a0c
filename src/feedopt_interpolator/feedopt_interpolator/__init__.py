"""The 1 kHz interpolator node."""
