"""The banded interior point that the time-optimal methods share."""
