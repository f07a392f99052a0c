"""The report of a run: one page for people who were not there."""
