"""Pictures and standard figures: ISO 230-2, ISO 230-4, error maps, learning curves."""
