"""Optimisers the planning methods share."""
