"""Brings the graph up and runs a whole session."""
