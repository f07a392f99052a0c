"""Commands that look at recordings."""
