"""Measurement of the planner: methods, windows, speed, scale."""
