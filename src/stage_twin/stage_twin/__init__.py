"""The digital twin: plant, controller, effects, and emulators of the wire protocols."""
