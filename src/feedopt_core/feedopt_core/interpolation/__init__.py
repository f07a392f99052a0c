"""From feed profile and toolpath to set points in time."""
