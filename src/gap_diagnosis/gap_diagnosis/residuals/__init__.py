"""What the nominal twin leaves: force balance and tracker residual as regression problems."""
