"""Curves and parameter maps that only benchmarks compare with."""
