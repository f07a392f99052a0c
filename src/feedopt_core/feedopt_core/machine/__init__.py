"""The machine: its file, its limits and drive models, and limits derived from them."""
