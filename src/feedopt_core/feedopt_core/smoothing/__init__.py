"""From programmed points to smooth segments."""
