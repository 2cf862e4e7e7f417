"""From bags to arrays on the grid of control ticks, and the checks that refuse bad ones."""
