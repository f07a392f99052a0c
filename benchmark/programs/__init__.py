"""Typical user programs, from file to audited plan."""
