"""Views of a recorded run: Rerun recordings with their layout, and pictures."""
