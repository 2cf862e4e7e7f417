"""The law of the remainder, checked blind."""
