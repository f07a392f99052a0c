"""The limits of a machine along a path: rows of every limit, standstill, stopping distance, utilisation."""
