"""Recording, replaying, reading, checking and repairing mcap sessions."""
