"""Sim-to-real gap diagnosis: where, which effect, how far it shrinks."""
