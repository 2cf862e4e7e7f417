"""The twin simulated as its user runs it, without and with effects."""
