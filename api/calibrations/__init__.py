"""Calibrations: the parameters of a followed station, found from what was measured, and twins moved to them."""
