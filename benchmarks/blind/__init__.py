"""Blind check of the gap diagnosis: sessions whose effects are withheld from it."""
