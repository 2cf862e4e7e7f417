"""Contour control: reference, contour error, cross-coupled CMAC, iterative learning."""
