"""Part of the time saved by an optimised feed that remains on ordinary controllers."""
