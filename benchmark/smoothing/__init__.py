"""Designs of the curve that replaces a run of short moves, compared by the motion time that results."""
