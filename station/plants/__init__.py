"""The plants: the equations of a station, behind one interface."""
