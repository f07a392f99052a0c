"""Watching a graph while it runs."""
