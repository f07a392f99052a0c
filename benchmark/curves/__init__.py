"""Curves and parameter maps used only for comparison in benchmarks."""
