"""Smooth transitions between the layers of a program."""
