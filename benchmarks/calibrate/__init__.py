"""Fits the probabilities of the diagnosis on sessions of known truth and measures intervals."""
