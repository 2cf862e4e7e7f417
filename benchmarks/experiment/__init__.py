"""What one experiment settles after a session of poor excitation, beside standard motions."""
