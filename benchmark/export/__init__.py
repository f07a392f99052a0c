"""What of an optimised feed survives on controllers that know nothing of it."""
