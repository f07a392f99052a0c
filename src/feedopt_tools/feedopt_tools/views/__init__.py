"""Looking at a recorded run: Rerun recordings, their layout, and pictures."""
