"""fg-Bernstein curves computed to high relative accuracy."""
