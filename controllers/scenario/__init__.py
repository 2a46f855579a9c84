"""MPC over a small tree of commands: arrivals are futures all candidates share, and shortages are counted in them."""
