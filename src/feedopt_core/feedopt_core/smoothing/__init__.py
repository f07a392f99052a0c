"""From programmed moves to the segments of a smooth path."""
