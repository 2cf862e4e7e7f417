"""Where points come from: a tracker, SpatialAnalyzer, or a recorded session."""
