"""Which effects: forward and backward selection on held-out gain."""
