"""Commands that read a program without the graph."""
