"""How long the tests wait for what must come."""

#: Patience for anything that a loaded machine must do [s]; nothing is asserted about it. Beside
#: twenty processes on two cores, calls that take a second of a core took a minute.
PATIENCE = 300.0
