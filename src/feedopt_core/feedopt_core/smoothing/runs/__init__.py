"""Runs of short moves as one smooth spline within the tolerance."""
