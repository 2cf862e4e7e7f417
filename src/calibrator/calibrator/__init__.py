"""Calibration models of the stage and the node that trains and applies them."""
