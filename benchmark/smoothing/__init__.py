"""Designs of the curve that replaces a run of short moves, compared by the resulting motion time."""
