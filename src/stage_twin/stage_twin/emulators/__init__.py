"""The twin as hardware: its plant behind the wire protocols of drive, tracker and stepper."""
