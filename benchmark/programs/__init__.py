"""Programs as users have them, from file to audited plan."""
