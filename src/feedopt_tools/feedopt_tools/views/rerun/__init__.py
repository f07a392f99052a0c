"""Views in Rerun: recordings, their layout, the viewer."""
