"""The planner measured: methods, windows, speed, scale."""
