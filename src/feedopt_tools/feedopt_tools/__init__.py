"""The feedopt command: recording, bags, replay, Rerun views, identification, export."""
