"""Mutants of the source: one changed operator or number each, and the tests that catch them."""
