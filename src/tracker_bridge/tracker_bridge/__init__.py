"""Bridge from a laser tracker stream to /tracker/point."""
