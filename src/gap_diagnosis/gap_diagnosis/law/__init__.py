"""What the remainder is a function of: an equation, or a smooth map."""
