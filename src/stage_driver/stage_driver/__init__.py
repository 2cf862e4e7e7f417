"""Driver of the XY stage: Zaber ASCII over a serial port, or a servo drive link at 1 kHz."""
