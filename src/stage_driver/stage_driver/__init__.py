"""Driver of the XY stage: Zaber ASCII over a serial port, or a servo drive link with the inner loop at 1 kHz."""
