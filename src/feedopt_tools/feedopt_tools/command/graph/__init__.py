"""Commands that run the graph."""
